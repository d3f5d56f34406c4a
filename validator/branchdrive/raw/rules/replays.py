"""Replay rules: replays differ from their nominal as the descriptor declares it.

Under noise, two drives are equal where the ego, and what is near it, are equal at every saved observation that both
have. Where replays are exact every recorded value counts. Source: spec/05-raw-streams.md#replay-noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch, Stretch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.contract.timing import PREDECESSOR_OFFSET
from branchdrive.raw.copies import HISTORIES, Copies
from branchdrive.raw.motion.contact import is_free
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

COMPARED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "observations": ("x_m", "y_m", "yaw_rad", "speed_mps"),
        "evidence": ("num_actors", "separation_m", "nearest_vehicle_gap_m", "nearest_pedestrian_gap_m"),
    }
)
"""Columns of the streams that two drives are compared in: the ego, and what is near it."""

_MOTION = ("x_m", "y_m", "speed_mps")
"""Columns that tell whether two histories are near each other."""


class Difference(NamedTuple):
    """First difference of a replay from its nominal; its row is -1 where there is none."""

    table: str
    column: str
    row: int
    of_nominal: int


EXPERT = ("expert_steer", "expert_throttle", "expert_brake")
"""Columns of the controls that follow from the state before them, whatever is applied."""

EQUAL = Difference("", "", -1, -1)


def _differences(view: ShardView) -> dict[int, Difference]:
    """The first difference of every complete nominal replay that shares a tick with its nominal."""
    if not view.num_rollouts:
        return {}
    is_compared = view.role("nominal_replay") & view.complete & (view.nominal >= 0) & view.complete[view.nominal]
    found: dict[int, Difference] = {}
    for table, columns in COMPARED.items():
        if table not in view:
            continue
        stream = view.stream(table)
        rows = np.flatnonzero((stream.rollout >= 0) & is_compared[stream.rollout])
        partner = stream.find(view.nominal[stream.rollout[rows]], stream.tick[rows])
        rows, partner = rows[partner >= 0], partner[partner >= 0]
        for attempt in np.unique(stream.rollout[rows]).tolist():
            found.setdefault(attempt, EQUAL)
        for column in columns:
            values: NDArray[np.generic] = stream[column]
            differs = rows[values[rows] != values[partner]]
            attempts, first = np.unique(stream.rollout[differs], return_index=True)
            for attempt, row in zip(attempts.tolist(), differs[first].tolist(), strict=True):
                if found[attempt] is EQUAL:
                    of_nominal = int(partner[np.searchsorted(rows, row)])
                    found[attempt] = Difference(table, column, row, of_nominal)
    return found


def comparable_replays(view: ShardView, subjects: Mask) -> Mask:
    """Complete nominal replays that share a tick with their complete nominal."""
    compared = np.zeros(view.num_rollouts, bool)
    compared[[*view.cached(_differences)]] = True
    return subjects & compared


@rule("BD-RPN-001")
def exact_replays_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, a nominal replay holds what its nominal holds, to the bit."""
    yield _repeats(view, comparable_replays(view, subjects))


@rule("BD-RPN-002")
def noisy_replays_differ(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where noise is injected, a nominal replay differs; where it is natural, not all of a shard are equal."""
    kind = view.descriptor.collection.replay_noise.kind
    differences, judged = view.cached(_differences), comparable_replays(view, subjects)
    if kind == "exact" or (kind == "natural" and judged.sum() < 2):
        judged[:] = False
    equal = judged & np.array([differences.get(i) is EQUAL for i in range(view.num_rollouts)], bool)
    if kind == "natural" and not equal[judged].all():
        equal[:] = False
    expected = f"a drive that differs from the nominal (replay noise is declared as {kind})"

    def describe(_: int) -> Mismatch:
        return Mismatch({"table": "observations"}, expected, "the same drive to the bit")

    yield Check.of_subjects(judged, equal, describe)


def complete_interventions(view: ShardView, subjects: Mask) -> Mask:
    """Complete branched interventions of complete nominals; one of the two has rows."""
    nominal, there = view.nominal, view.observations.is_there
    of_whole = view.role("intervention") & view.complete & view.branched & (nominal >= 0) & view.complete[nominal]
    return np.asarray(subjects & of_whole & (there | there[nominal]))


def _last_ticks(view: ShardView) -> NDArray[np.int64]:
    """Tick up to which exact attempts repeat their nominal ``[rollouts]``: the branch, or the last of both."""
    observations = view.observations
    ends = np.append(observations.tick, -1)[np.where(observations.is_there, observations.stop - 1, -1)]
    return np.where(view.role("intervention"), view.branch_tick, np.minimum(ends, ends[view.nominal])).astype(np.int64)


def _exact_differences(view: ShardView) -> dict[int, Mismatch]:
    """The first value that an attempt should repeat of its nominal and does not, of those that have one."""
    everyone, last_tick = np.ones(view.num_rollouts, bool), _last_ticks(view)
    attempts = np.flatnonzero(complete_interventions(view, everyone) | comparable_replays(view, everyone))
    copies = view.cached(Copies)
    equal = [copies.repeat(table, attempts, last_tick[attempts]) for table in HISTORIES if table in view]
    found = {i: _first_difference(view, i, last_tick[i]) for i in attempts[~np.logical_and.reduce(equal)].tolist()}
    return {i: mismatch for i, mismatch in found.items() if mismatch is not None}


def _first_difference(view: ShardView, attempt: int, last_tick: int) -> Mismatch | None:
    """The first value up to a tick of an attempt that its nominal does not have, if there is one."""
    nominal, branched = int(view.nominal[attempt]), view.role("intervention")[attempt]
    for table, last_offset in HISTORIES.items():
        if table not in view:
            continue
        stream = view.stream(table)
        own, expected = (_rows_until(stream, i, last_tick + last_offset) for i in (attempt, nominal))
        if len(own) != len(expected):
            where = "before the branch" if branched else f"up to tick {last_tick + last_offset}"
            return Mismatch({"table": table}, f"{len(expected)} rows {where}", f"{len(own)} rows")
        columns = [column.name for column in TABLES[table].columns if column.name != "rollout_id"]
        differs = {name: stream.differs(name, own, expected) for name in columns}
        anywhere = np.logical_or.reduce(list(differs.values()))
        if anywhere.any():
            place = int(np.argmax(anywhere))
            column = next(name for name in columns if differs[name][place])
            row, of_nominal = int(own[place]), int(expected[place])
            texts = [quote(stream[column][i]) if stream.valid(column)[i] else "null" for i in (of_nominal, row)]
            location: Location = {"table": table, "column": column, "tick": int(stream["tick"][row])}
            return Mismatch(location, f"{texts[0]} as in the nominal", texts[1])
    return None


def _rows_until(stream: StreamView, attempt: int, last_tick: int) -> NDArray[np.intp]:
    """Rows of an attempt in the order of their keys, since the order of rows carries no meaning."""
    rows = np.arange(stream.start[attempt], stream.stop[attempt])
    rows = rows[: np.searchsorted(stream.tick[rows], last_tick, side="right")]
    further = [_sortable(stream, column)[rows] for column in reversed(TABLES[stream.name].key[2:])]
    return rows[np.lexsort((*further, stream.tick[rows]))]


def _sortable(stream: StreamView, column: str) -> NDArray[np.generic]:
    return stream.categories(column)[0] if stream.is_text(column) else stream[column]


def _expert_differences(view: ShardView, attempts: NDArray[np.int64]) -> dict[int, Mismatch]:
    """Commands of the expert at the branch that are not the nominal's, whose state is the same there, by attempt."""
    controls = view.stream("controls")
    ticks = view.branch_tick[attempts]
    own, expected = (controls.find(rollouts, ticks) for rollouts in (attempts, view.nominal[attempts]))
    both = (own >= 0) & (expected >= 0)
    found: dict[int, Mismatch] = {}
    for column in EXPERT:
        values = controls[column]
        for attempt, row, of_nominal in zip(attempts[both].tolist(), own[both], expected[both], strict=True):
            if values[row] != values[of_nominal]:
                location: Location = {"table": "controls", "column": column, "tick": int(controls.tick[row])}
                wanted = f"{quote(values[of_nominal])} as in the nominal"
                found.setdefault(attempt, Mismatch(location, wanted, quote(values[row])))
    return found


@rule("BD-RPN-003")
def exact_histories_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are exact, an intervention holds its nominal's values before the branch, and its expert at it."""
    judged = complete_interventions(view, subjects)
    yield Check.of_any(_repeats(view, judged), _expert_repeats(view, judged))


def _repeats(view: ShardView, judged: Mask) -> Check:
    """Whether attempts repeat their nominal as far as they should, where replays are declared to be exact."""
    return _check(judged & _is_exact(view), view.cached(_exact_differences) if _is_exact(view) else {})


def _expert_repeats(view: ShardView, judged: Mask) -> Check:
    """Whether the expert commands at the branch what it commands of the nominal, where replays are exact."""
    judged = judged & _is_exact(view)
    return _check(judged, _expert_differences(view, np.flatnonzero(judged)))


def _is_exact(view: ShardView) -> bool:
    return view.descriptor.collection.replay_noise.kind == "exact"


def _check(judged: Mask, differences: Mapping[int, Mismatch]) -> Check:
    differing = np.zeros(len(judged), bool)
    differing[[*differences]] = True
    return Check.of_subjects(judged, judged & differing, differences.__getitem__, *_stretches(len(judged), differences))


def _stretches(num_rollouts: int, differences: Mapping[int, Mismatch]) -> Iterator[Stretch]:
    """The first difference of each attempt, by the table that it is in."""
    for table in HISTORIES:
        ticks = np.full(num_rollouts, Stretch.UNKNOWN, np.int64)
        is_there = np.zeros(num_rollouts, bool)
        for attempt, mismatch in differences.items():
            if mismatch.location["table"] == table:
                is_there[attempt], ticks[attempt] = True, mismatch.location.get("tick", Stretch.UNKNOWN)
        if is_there.any():
            yield Stretch(table, ticks, ticks, is_there)


@rule("BD-RPN-005")
def noisy_histories_stay_near(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where noise is declared, a replay drives before the branch near its nominal, and about as fast."""
    observations, nominal, bounds = view.observations, view.nominal, physical_bounds()
    judged = subjects & ~view.role("nominal") & view.branched & (nominal >= 0) & subjects[nominal]
    if view.descriptor.collection.replay_noise.kind == "exact":
        judged[:] = False
    offset = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    rows = np.flatnonzero(
        np.append(judged, False)[observations.rollout] & (offset >= PREDECESSOR_OFFSET) & (offset <= 0)
    )
    partner = observations.find(nominal[observations.rollout[rows]], observations.tick[rows])
    free = np.append(view.cached(is_free), False)
    rows, partner = rows[free[rows] & free[partner]], partner[free[rows] & free[partner]]
    away = {name: observations[name][rows].astype(np.float64) - observations[name][partner] for name in _MOTION}
    compared, differs = (np.zeros(len(observations), bool) for _ in range(2))
    away_m, faster_mps = np.hypot(away["x_m"], away["y_m"]), np.abs(away["speed_mps"])
    compared[rows], differs[rows] = True, (away_m > bounds.history_m) | (faster_mps > bounds.history_mps)
    summary = observations.by_rollout(differs)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        (place,) = np.flatnonzero(rows == row)
        location: Location = {"table": "observations", "column": "x_m", "tick": int(observations.tick[row])}
        expected = f"a history within {bounds.history_m:g} m and {bounds.history_mps:g} m/s of the nominal's"
        found = f"{away_m[place]:.1f} m and {faster_mps[place]:.1f} m/s away"
        return Mismatch(location, expected, found, int(summary.count[i]))

    judged = judged & observations.by_rollout(compared).any
    yield Check.of_subjects(judged, judged & summary.any, describe, summary.stretch)
