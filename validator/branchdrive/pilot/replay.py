"""Replay noise of a pilot before and after the branch, and the fidelity thresholds that it would give.

Before the branch a replay should be its nominal; after it, only a nominal replay should. Source: spec/11-fidelity.md.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.limits import threshold_floors
from branchdrive.contract.text import NONE, counted, percent
from branchdrive.contract.timing import FUTURE_OFFSETS, TICK_S
from branchdrive.pilot.pilot import Part, Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.quality.fidelity import bank_rows
from branchdrive.quality.replay import canonical_pairs
from branchdrive.quality.threshold import FLOORS, MIN_SUPPORT, QUANTILE, VARIABLES, Thresholds, fit_thresholds, passes
from branchdrive.raw.window import take_float, window_rows
from branchdrive.statistics.split import SHARES, TRAINING
from branchdrive.text.table import Column, Table

__all__ = ["replay_noise"]

Array = NDArray[np.float64]

_TITLE = "Replay noise and fidelity thresholds"


_STAGES = ("eligible", "integrity_complete")
"""Stages of the groups that are looked at: where all replays differ though none should, no group is eligible for it."""

_EXACT = ("BD-RPN-001", "BD-RPN-003", "BD-RPN-004")
"""Rules on replays that are declared to be exact."""


def replay_noise(pilot: Pilot, *, is_early: bool) -> Section:
    """Discrepancies before the branch with the thresholds they give, and of nominal replays after it.

    Args:
        pilot: What was read.
        is_early: Whether effects come before their commands, so that replays differ at the branch already.
    """
    if not pilot.rows:
        return Section("replay", _TITLE, not_examined=[pilot.no_rows])
    pairs, groups = pilot.rows["pairs"], pilot.rows["group_quality"]
    stages: list[list[str]] = [groups["group_id"][np.asarray(groups[stage], bool)].tolist() for stage in _STAGES]
    eligible = next((group_ids for group_ids in stages if group_ids), [])
    if not eligible:
        return Section("replay", _TITLE, not_examined=["no group is integrity-complete (see Funnel)"])
    values = np.stack([np.ma.filled(pairs[v.name].astype(np.float64), np.inf) for v in VARIABLES], axis=1)
    rows = bank_rows(pairs, eligible)
    there = np.asarray(pairs["has_pedestrian"], bool)[rows].any(axis=1)
    thresholds = fit_thresholds(values[rows], has_pedestrian=there)
    replays = values[np.asarray(pairs["kind"] == "nominal_replay", bool)]
    passed = passes(values[rows], thresholds)
    kind = pilot.descriptor.collection.replay_noise.kind
    is_exact = not (values[rows] > 0).any() and not (replays > 0).any()
    facts = [
        f"The descriptor declares {kind} replays. "
        + ("Every replay equals its nominal before the branch to the last bit." if is_exact
           else "Replays differ from their nominal before the branch, as the table says."),
        f"With the thresholds that these groups give, {percent(float(passed.core.mean()))} of the replays pass the "
        f"core variables, and {passed.core_bank.sum()} of {counted(len(eligible), 'group')} with the whole bank.",
    ]  # fmt: skip
    is_noisy = not is_exact and (not is_early or bool((replays > 0).any()))
    concerns, not_examined = _judged(pilot, thresholds, values[rows], kind=kind, is_exact=not is_noisy)
    if is_early and not is_noisy:
        facts.append("They do at the branch alone, where effects come before their commands (see Action response).")
    after = _after_branch(pilot)
    tables = [_before_table(values[rows].reshape(-1, len(VARIABLES)), replays, thresholds)]
    if after is None:
        not_examined.append(
            "noise after the branch: no group has a nominal replay; record two of each nominal, for they alone say how "
            "far outcomes differ by chance"
        )
    else:
        tables.append(_after_table(after))
        last_m = after["position_m"][:, -1]
        facts.append(
            f"{FUTURE_OFFSETS[-1] * TICK_S:g} s after the branch nominal replays are {np.median(last_m):.3g} m from "
            f"their nominal in the median, {last_m.max():.3g} m at most ({counted(len(last_m), 'replay')})."
        )
        if is_exact and any((part > 0).any() for part in after.values()):
            concerns.append(
                Concern(
                    "Nominal replays equal their nominal before the branch and differ after it, though nothing tells "
                    "them apart.",
                    "Look for what starts at the branch: a random generator that is seeded there or shared with the "
                    "trigger, or traffic that depends on wall-clock time.",
                )
            )
    figures, explains = _figures(thresholds, values[rows], after), _EXACT if concerns else ()
    return Section("replay", _TITLE, facts, concerns, tables, not_examined, figures, explains)


def _judged(
    pilot: Pilot, thresholds: Thresholds, values: Array, *, kind: str, is_exact: bool
) -> tuple[list[Concern], list[str]]:
    concerns = []
    if kind == "exact" and not is_exact:
        worst = int(
            np.argmax(np.where(np.isfinite(values), values, np.inf).max(axis=(0, 1)) / np.maximum(FLOORS, 1e-9))
        )
        concerns.append(
            Concern(
                f"The descriptor declares exact replays, but {VARIABLES[worst].name} differs by up to "
                f"{values[..., worst].max():.3g} before the branch: the simulator keeps something from one rollout to "
                "the next, or draws it again.",
                "Find what is kept: start every rollout from a fresh world, and seed every random generator from the "
                "group's seed alone. Or declare the noise as `natural` or `injected`.",
            )
        )
    lost = [v.name for i, v in enumerate(VARIABLES) if thresholds.judged[i] and not math.isfinite(thresholds.values[i])]
    if lost:
        concerns.append(
            Concern(
                f"{', '.join(lost)}: in some group something is there in one of nominal and replay only, so that no "
                "finite threshold holds it.",
                "Find the actor that one drive has and the other lacks, or that noise brings into range at another "
                "observation; such a pair never passes.",
            )
        )
    not_examined = []
    num_training = pilot.num_wanted * SHARES[TRAINING] / 100
    if not thresholds.judged.all():
        share = thresholds.support / thresholds.num_groups
        outlook = "would" if share * num_training >= MIN_SUPPORT else "would not"
        not_examined.append(
            f"pedestrian gap: {thresholds.support} groups have a pedestrian in range, fewer than {MIN_SUPPORT}; of "
            f"{counted(pilot.num_wanted, 'group')} about {share * num_training:,.0f} training groups would, so that it "
            f"{outlook} be judged"
        )
    if thresholds.num_groups < 1 / (1 - QUANTILE):
        not_examined.append(
            f"the {QUANTILE} quantile itself: of {counted(thresholds.num_groups, 'group')} it is the largest value, "
            "with 100 or more it leaves out the worst in a hundred"
        )
    return concerns, not_examined


def _before_table(interventions: Array, replays: Array, thresholds: Thresholds) -> Table:
    floors, rows = threshold_floors(), []
    for i, variable in enumerate(VARIABLES):
        unit = LAYER_TABLES["pairs"][variable.name].unit
        rows.append(
            [
                variable.name, *(_largest(values[:, i]) for values in (replays, interventions)),
                f"{floors[variable.name]:g}", _number(thresholds.values[i]) if thresholds.judged[i] else "not judged",
                unit or "",
            ]
        )  # fmt: skip
    heads = [
        Column.name("Variable", is_code=True), Column("Nominal replays, largest"), Column("Interventions, largest"),
        Column("Floor"), Column("Threshold"), Column("Unit", is_text=True),
    ]  # fmt: skip
    return Table("Before the branch", heads, rows)


def _largest(values: Array) -> str:
    return _number(float(values.max())) if len(values) else NONE


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "missing on one side"


def _after_branch(pilot: Pilot) -> dict[str, Array] | None:
    """How far nominal replays are from their nominal after the branch, ``[replays, 10]`` each; ``None`` for none."""
    found: dict[str, list[Array]] = {"position_m": [], "heading_deg": [], "speed_mps": []}
    for part in pilot.parts:
        for name, values in _of_part(part).items():
            found[name].append(values)
    joined = {name: np.concatenate(values) for name, values in found.items()}
    return joined if len(joined["position_m"]) else None


def _of_part(part: Part) -> dict[str, Array]:
    _, pairs = canonical_pairs(part.view, part.examination)
    stream = part.view.observations
    rows = [window_rows(part.view, stream, side, FUTURE_OFFSETS) for side in pairs]
    x, y, yaw, speed = (
        take_float(stream, name, rows[0]) - take_float(stream, name, rows[1])
        for name in ("x_m", "y_m", "yaw_rad", "speed_mps")
    )
    turn = np.abs((yaw + np.pi) % (2 * np.pi) - np.pi)
    whole = ((rows[0] >= 0) & (rows[1] >= 0)).all(axis=1)
    return {
        "position_m": np.hypot(x, y)[whole],
        "heading_deg": np.degrees(turn)[whole],
        "speed_mps": np.abs(speed)[whole],
    }


def _after_table(after: dict[str, Array]) -> Table:
    places = [1, 3, 9]
    times = [FUTURE_OFFSETS[place] * TICK_S for place in places]
    rows = [
        [name, *(f"{np.median(values[:, place]):.3g} / {values[:, place].max():.3g}" for place in places)]
        for name, values in after.items()
    ]
    heads = [
        Column.name("Nominal replay - nominal", is_code=True),
        *(Column(f"{time_s:g} s, median / largest") for time_s in times),
    ]
    return Table("After the branch", heads, rows)


def _figures(thresholds: Thresholds, values: Array, after: dict[str, Array] | None) -> dict[str, Any]:
    finite = [float(v) if math.isfinite(v) else None for v in values.reshape(-1, len(VARIABLES)).max(axis=0)]
    return {
        "num_groups": thresholds.num_groups,
        "pedestrian_support": thresholds.support,
        "thresholds": {
            variable.name: float(thresholds.values[i]) if math.isfinite(thresholds.values[i]) else None
            for i, variable in enumerate(VARIABLES)
        },
        "largest": {variable.name: finite[i] for i, variable in enumerate(VARIABLES)},
        "after_branch": None
        if after is None
        else {
            name: {"median": np.median(v[:, -1]).item(), "largest": v[:, -1].max().item()} for name, v in after.items()
        },
    }
