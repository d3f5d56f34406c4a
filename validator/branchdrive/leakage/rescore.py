"""What an auditor finds when it fits the regressions of the battery again.

Regressions have one solution, so their scores recompute; recurrent tests train networks and are taken as stated.

Source: this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from branchdrive.leakage.agreement import Difference, compared
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.parity import ways
from branchdrive.leakage.parity_protocol import CONTROLS, SEQUENCE_TESTS, ParityProtocol
from branchdrive.leakage.plausible import is_plausible
from branchdrive.leakage.score import MEASURES
from branchdrive.leakage.sequence import Unavailable

__all__ = ["rescored_differences"]

_DRAWN = 1_999
"""Permutations of labels that are drawn again: 20 of them at least reach a p-value that is not near the level."""


def rescored_differences(
    battery: Mapping[str, Any], inputs: ReplayInputs, protocol: ParityProtocol, seed: int
) -> list[Difference]:
    """Scores of controls and regressions of a stated battery against those of recomputed inputs."""
    drawn = min(_DRAWN, protocol.num_permutations)
    quick = replace(protocol, num_permutations=drawn)
    found: list[Difference] = []
    for index, (way, said) in enumerate(zip(ways(inputs), battery["ways"], strict=True)):
        parts = way.parts(seed=seed, protocol=quick, classifier=Unavailable("not repeated"))
        stated = [*said["controls"], *said["tests"]]
        for place, (part, result) in enumerate(zip(parts, stated, strict=True)):
            if part.name in SEQUENCE_TESTS or result["score"] is None or part.compute is None:
                continue
            kind, at = ("controls", place) if place < len(CONTROLS) else ("tests", place - len(CONTROLS))
            pointer = f"/battery/ways/{index}/{kind}/{at}/score"
            score = part.compute()["score"]
            names = ("accuracy", "accuracy_interval", "log_likelihood", "identical")
            found += compared(pointer, {n: score[n] for n in names}, {n: result["score"][n] for n in names})
            for measure in MEASURES:
                name = f"p_{measure}"
                reached, p = round(score[name] * (drawn + 1)) - 1, result["score"][name]
                if not score["identical"] and not is_plausible(reached, drawn, p, protocol.num_permutations):
                    told = f"a p-value that fits {reached:,} of {drawn:,} permutations"
                    found.append(Difference(f"{pointer}/{name}", told, p))
    return found
