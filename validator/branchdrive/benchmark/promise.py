"""What a report prints of the guards' promises: each where it is claimed, with what takes from it beside it.

Source: spec/14-benchmark.md#guard.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from branchdrive.benchmark.guard.calibration import CONDITIONAL
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.warning import CALIBRATION_READ

__all__ = ["UNGUARDED", "noise_floor", "promises"]

UNGUARDED = (
    "`unguarded` takes the best utility of the predictions' mean over seeds; the selectors of the ranking choose by "
    "each seed, and their value is a mean over seeds, so that the two differ. `action_prior` takes the same candidate "
    "in every group, without a guard."
)
"""What two rows of a guard's table are."""

_METHODS = {"conformal": "The selection-path guard", "learn_then_test": "Learn then test"}


def promises(results: Mapping[str, Any]) -> list[str]:
    """Paragraphs on what the guards promise; none where no guard was judged.

    Args:
        results: Document ``results.json``, which conforms to its schema.
    """
    guard = results["guard"]
    found = []
    for method, title in _METHODS.items():
        refused = [profile["profile"] for profile in guard["profiles"] if profile[method]["refusal"] is not None]
        if refused:
            found.append(f"{title} was not judged under {', '.join(refused)}: it promises nothing there.")
    texts = guard["guarantee"]
    if CALIBRATION_READ in results["warnings"] and any(texts[method] is not None for method in _METHODS):
        found.append(CALIBRATION_READ)
    conditional = None if texts["conformal"] is None else CONDITIONAL
    claimed = (texts["conformal"], conditional, texts["learn_then_test"], texts["global_margin"])
    return [*found, *(text for text in claimed if text is not None)]


def noise_floor(results: Mapping[str, Any]) -> str | None:
    """A sentence on how often a repeated nominal would be a violation; ``None`` where the noise is unknown.

    Args:
        results: As above.
    """
    noise, tolerance_m = results["noise"], results["guard"]["tolerance_m"]
    if noise is None or not (noise["losses"]["num_groups"] and noise["losses"]["num_repeats"]):
        return None
    losses, noisy = noise["losses"], noise["tolerance"][SEPARATION]
    groups, repeats = losses["num_groups"], losses["num_repeats"]
    losing, repeats_losing = losses["num_groups_losing"], losses["num_repeats_losing"]
    found = (
        f"Repeated nominals lose more than {tolerance_m:g} m of separation in {losing} of {groups} training groups "
        f"({100 * losing / groups:.1f} %), {repeats_losing} of {repeats} repeats "
        f"({100 * repeats_losing / repeats:.1f} %)."
    )
    if noisy is not None and tolerance_m < noisy:
        found += (
            f" The tolerance of {tolerance_m:g} m is below the noise tolerance of separation, {noisy:.4f} m: single "
            "violations may be noise, and a rate is to be read against that of the repeats."
        )
    return found
