"""What every table of results warns of: a test set that is no longer untouched, and models that were not locked.

Source: paper, "Training and Test Locking"; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Sequence

from branchdrive.quality.ledger import PREDICTION_ACCESS, RELEASE_ACCESS, SELECTION_ACCESS, Ledger, accesses
from branchdrive.quality.text import access_sentence

__all__ = ["CALIBRATION_READ", "warnings"]

CALIBRATION_READ = (
    "Calibration outcomes were read under an earlier ranking lock: the premise of the guarantees, that everything else "
    "was fixed before calibration outcomes were read, no longer holds."
)
"""What takes from the guarantees of guards where selections were evaluated more than once."""


def warnings(
    ledger: Ledger,
    *,
    unlocked: Sequence[str] = (),
    changed: Sequence[str] = (),
    of_release: Ledger | None = None,
    has_calibration: bool = True,
) -> list[str]:
    """Sentences that every table of results carries; none where all is as it should be.

    Args:
        ledger: ``benchmark/ledger.json``.
        unlocked: Models whose predictions come from no locked checkpoint.
        changed: Files of checkpoints that are not those that were locked.
        of_release: The release's ``quality/ledger.json``; None leaves its accesses out.
        has_calibration: Whether there are calibration groups, whose outcomes are read where selections are evaluated.
    """
    found: list[str] = []
    for event, subject in ((PREDICTION_ACCESS, "predictions"), (SELECTION_ACCESS, "selections")):
        count = len(accesses(event, ledger, of_release))
        if count > 1:
            found.append(
                f"The test partition was accessed {count} times for {subject}, each time under another lock: "
                "it is no longer an untouched test set, and results on it are optimistic."
            )
    if has_calibration and len(accesses(SELECTION_ACCESS, ledger, of_release)) > 1:
        found.append(CALIBRATION_READ)
    if of_release is not None and len(accesses(RELEASE_ACCESS, of_release)) > 1:
        found.append(access_sentence(of_release))
    found += [f"The checkpoint `{file}` is not the one that was locked." for file in sorted(changed)]
    found += [f"Predictions of {model} come from no locked checkpoint." for model in sorted(unlocked)]
    return found
