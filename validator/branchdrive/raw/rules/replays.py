"""Replay rules: replays differ from their nominal as the descriptor declares it.

Two drives are equal where the ego, and what is near it, are equal to the bit at every saved observation that both
have. Before the branch every recorded value counts. Source: spec/05-raw-streams.md#replay-noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

COMPARED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "observations": ("x_m", "y_m", "yaw_rad", "speed_mps"),
        "evidence": ("num_actors", "separation_m", "nearest_vehicle_gap_m", "nearest_pedestrian_gap_m"),
    }
)
"""Columns of the streams that two drives are compared in: the ego, and what is near it."""

HISTORIES: Mapping[str, int] = MappingProxyType({"observations": 0, "evidence": 0, "actors": 0, "controls": -1})
"""Streams whose rows before the branch are compared, and the offset of the last such row from ``t_b``."""


class Difference(NamedTuple):
    """First difference of a replay from its nominal; its row is -1 where there is none."""

    table: str
    column: str
    row: int
    of_nominal: int


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


def _subjects(view: ShardView, subjects: Mask) -> Mask:
    compared = np.zeros(view.num_rollouts, bool)
    compared[[*view.cached(_differences)]] = True
    return subjects & compared


@rule("BD-RPN-001")
def exact_replays_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, a nominal replay is its nominal to the bit."""
    differences, judged = view.cached(_differences), _subjects(view, subjects)
    if view.descriptor.collection.replay_noise.kind != "exact":
        judged[:] = False
    differing = np.array([i in differences and differences[i] is not EQUAL for i in range(view.num_rollouts)], bool)

    def describe(i: int) -> Mismatch:
        table, column, row, of_nominal = differences[i]
        stream = view.stream(table)
        place: Location = {"table": table, "column": column, "tick": int(stream.tick[row])}
        return Mismatch(place, f"{quote(stream[column][of_nominal])} as in the nominal", quote(stream[column][row]))

    yield Check.of_subjects(judged, judged & differing, describe)


@rule("BD-RPN-002")
def noisy_replays_differ(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where noise is injected, a nominal replay differs; where it is natural, not all of a shard are equal."""
    kind = view.descriptor.collection.replay_noise.kind
    differences, judged = view.cached(_differences), _subjects(view, subjects)
    if kind == "exact":
        judged[:] = False
    equal = judged & np.array([differences.get(i) is EQUAL for i in range(view.num_rollouts)], bool)
    if kind == "natural" and (not equal[judged].all() or judged.sum() < 2):
        equal[:] = False
    expected = f"a drive that differs from the nominal (replay noise is declared as {kind})"

    def describe(_: int) -> Mismatch:
        return Mismatch({"table": "observations"}, expected, "the same drive to the bit")

    yield Check.of_subjects(judged, equal, describe)


def _intervened(view: ShardView, subjects: Mask) -> Mask:
    """Complete branched interventions of complete nominals."""
    nominal = view.nominal
    return np.asarray(
        subjects & view.role("intervention") & view.complete & view.branched & (nominal >= 0) & view.complete[nominal]
    )


def _history_difference(view: ShardView, attempt: int) -> Mismatch | None:
    """The first value before the branch of an attempt that its nominal does not have, if there is one."""
    nominal, branch_tick = int(view.nominal[attempt]), int(view.branch_tick[attempt])
    for table, last_offset in HISTORIES.items():
        if table not in view:
            continue
        stream = view.stream(table)
        own, expected = (_rows_until(stream, i, branch_tick + last_offset) for i in (attempt, nominal))
        if len(own) != len(expected):
            return Mismatch({"table": table}, f"{len(expected)} rows before the branch", f"{len(own)} rows")
        columns = [column.name for column in TABLES[table].columns if column.name != "rollout_id"]
        differs = {name: _bits_differ(stream, name, own, expected) for name in columns}
        anywhere = np.logical_or.reduce(list(differs.values()))
        if anywhere.any():
            place = int(np.argmax(anywhere))
            column = next(name for name in columns if differs[name][place])
            row, of_nominal = int(own[place]), int(expected[place])
            texts = [quote(stream[column][i]) if stream.valid(column)[i] else "null" for i in (of_nominal, row)]
            location: Location = {"table": table, "column": column, "tick": int(stream.tick[row])}
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


def _bits_differ(stream: StreamView, column: str, own: NDArray[np.intp], expected: NDArray[np.intp]) -> Mask:
    """Where the rows `own` hold other bits than the rows `expected`, or are null where those are not."""
    if stream.is_text(column):
        codes, _ = stream.categories(column)
        return np.asarray(codes[own] != codes[expected])
    values, valid = stream[column], stream.valid(column)
    bits = values.view(np.dtype(f"u{values.itemsize}"))
    return np.asarray((bits[own] != bits[expected]) | (valid[own] != valid[expected]))


@rule("BD-RPN-003")
def exact_histories_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, an intervention holds the values of its nominal before the branch."""
    judged = _intervened(view, subjects)
    if view.descriptor.collection.replay_noise.kind != "exact":
        judged[:] = False
    found = {i: _history_difference(view, i) for i in np.flatnonzero(judged).tolist()}
    differences = {i: mismatch for i, mismatch in found.items() if mismatch is not None}
    differing = np.zeros(view.num_rollouts, bool)
    differing[[*differences]] = True
    yield Check.of_subjects(judged, differing, differences.__getitem__)


@rule("BD-RPN-004")
def exact_images_are_equal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Where replays are declared to be exact, an intervention holds the images of its nominal before the branch."""
    if "frames" not in view:
        return
    frames, judged = view.stream("frames"), _intervened(view, subjects)
    if view.descriptor.collection.replay_noise.kind != "exact":
        judged[:] = False
    rows = np.flatnonzero((frames.rollout >= 0) & np.append(judged, False)[frames.rollout])
    rows = rows[frames.tick[rows] <= view.branch_tick[frames.rollout[rows]]]
    camera, checksum = frames.categories("camera")[0].astype(np.int64), frames.categories("checksum")[0]
    key = _moment(frames.rollout, camera, frames.tick)
    order = np.argsort(key, kind="stable")
    wanted = _moment(view.nominal[frames.rollout[rows]], camera[rows], frames.tick[rows])
    place = np.minimum(np.searchsorted(key[order], wanted), max(len(order) - 1, 0))
    of_nominal = order[place]
    has_both = key[of_nominal] == wanted
    rows, of_nominal = rows[has_both], of_nominal[has_both]
    differs = np.zeros(len(frames), bool)
    differs[rows[checksum[rows] != checksum[of_nominal]]] = True
    compared = np.zeros(len(frames), bool)
    compared[rows] = True
    summary = frames.by_rollout(differs)
    judged = judged & frames.by_rollout(compared).any

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        name, tick = str(frames["camera"][row]), int(frames.tick[row])
        location: Location = {"table": "frames", "column": "checksum", "tick": tick, "camera": name}
        found = f"another image of {name}"
        return Mismatch(location, f"the image of {name} of the nominal", found, int(summary.count[i]))

    yield Check.of_subjects(judged, judged & summary.any, describe)


def _moment(rollout: NDArray[np.int64], camera: NDArray[np.int64], tick: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number for every attempt, camera and tick: cameras are fewer than 2 ** 12, ticks than 2 ** 21."""
    return (rollout << 33) + (camera << 21) + tick
