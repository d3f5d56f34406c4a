"""What the numbers of the paper's battery amount to.

The family of Holm's procedure are both measures of every test that ran, of all ways together. A way is *trusted*
where both measures find both positive controls and neither finds the random labels. The status of a test is

* ``not_run`` where it could not run;
* ``inconclusive`` where its scores are identical within every group, its way is not trusted, or permutations
  are too few for it to fail;
* ``fail`` where an adjusted p is at most `alpha`, and ``pass`` where none is.

It is a diagnostic: what a release may claim is the gate's to say.

Source: paper VI-A; that a classifier which tells nothing apart is inconclusive is this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from branchdrive.leakage.parity_protocol import CONTROLS, ParityProtocol
from branchdrive.leakage.score import MEASURES
from branchdrive.statistics.holm import holm

__all__ = ["judged_battery"]


def judged_battery(ways: Sequence[Mapping[str, Any]], protocol: ParityProtocol) -> dict[str, Any]:
    """The battery with all that follows from its scores.

    Args:
        ways: Each with `name`, `num_actions`, `num_groups`, and `controls` and `tests` with `name`, `score` (None
            where it could not run), `training` and, for one that could not run, `reason`.
        protocol: Numbers of the battery.
    """
    family = [
        (i, j, measure)
        for i, way in enumerate(ways)
        for j, test in enumerate(way["tests"])
        if test["score"] is not None
        for measure in MEASURES
    ]
    adjusted = holm([ways[i]["tests"][j]["score"][f"p_{measure}"] for i, j, measure in family]).tolist()
    by_test: dict[tuple[int, int], dict[str, float]] = {}
    for (i, j, measure), p in zip(family, adjusted, strict=True):
        by_test.setdefault((i, j), {})[measure] = p
    least = len(family) / (protocol.num_permutations + 1)
    judged = [
        _judged_way(way, [by_test.get((i, j)) for j in range(len(way["tests"]))], least, protocol)
        for i, way in enumerate(ways)
    ]
    ran = [way["trusted"] for way in judged if way["trusted"] is not None]
    names = [f"{ways[i]['name']}/{ways[i]['tests'][j]['name']}/{measure}" for i, j, measure in family]
    return {"trusted": bool(ran) and all(ran), "family": names, "ways": judged}


def _judged_way(
    way: Mapping[str, Any], adjusted: Sequence[dict[str, float] | None], least: float, protocol: ParityProtocol
) -> dict[str, Any]:
    controls = [_judged_control(control, protocol.control_alpha) for control in way["controls"]]
    astray = [control["name"] for control in controls if control["found"] is not None and not control["as_expected"]]
    ran = all(control["found"] is not None for control in controls)
    trusted = not astray if ran else None
    tests = []
    for test, p in zip(way["tests"], adjusted, strict=True):
        status, reason = _status(test, p, astray, least, protocol)
        tests.append(
            {
                "name": test["name"],
                "score": test["score"],
                "training": test["training"],
                "p_adjusted": p,
                "status": status,
                "reason": reason,
            }
        )
    return {
        "name": way["name"],
        "num_actions": way["num_actions"],
        "chance": 1 / way["num_actions"],
        "num_groups": dict(way["num_groups"]),
        "trusted": trusted,
        "controls": controls,
        "tests": tests,
    }


def _judged_control(control: Mapping[str, Any], alpha: float) -> dict[str, Any]:
    score = control["score"]
    positive = control["name"] != CONTROLS[-1]
    found = as_expected = None
    if score is not None:
        hits = [score[f"p_{measure}"] <= alpha for measure in MEASURES]
        found = all(hits) if positive else any(hits)
        as_expected = found == positive
    return {
        "name": control["name"],
        "score": score,
        "found": found,
        "as_expected": as_expected,
        "reason": "" if score is not None else control["reason"],
    }


def _status(
    test: Mapping[str, Any],
    p_adjusted: Mapping[str, float] | None,
    astray: Sequence[str],
    least: float,
    protocol: ParityProtocol,
) -> tuple[str, str]:
    if p_adjusted is None:
        return "not_run", test["reason"]
    if test["score"]["identical"]:
        return "inconclusive", "Scores are identical within every group, as of a classifier that tells nothing apart."
    if astray:
        return "inconclusive", f"The control `{astray[0]}` did not come out as it must."
    if least > protocol.alpha:
        return "inconclusive", f"The permutations reach an adjusted p of {least:.2g} at best."
    measure, smallest = min(p_adjusted.items(), key=lambda item: item[1])
    if smallest <= protocol.alpha:
        return "fail", f"`{measure}` has adjusted p {smallest:.2g}, at most {protocol.alpha:g}."
    return "pass", f"No adjusted p is at most {protocol.alpha:g}; the smallest is {smallest:.2g}."
