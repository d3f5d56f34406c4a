"""Rows that are copies: those of an attempt that hold, bit for bit, what its nominal holds.

Where replays are exact, an intervention repeats its nominal up to the branch, and a replay all of it. What a copy says
has been said by its source, so it is judged once. Nothing is assumed of what a dataset declares: rows are compared, and
where none is a copy, every row is its own source.

Source: spec/05-raw-streams.md#replay-noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple
from weakref import proxy

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Mask
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import StreamView

__all__ = ["HISTORIES", "Copied", "Copies"]

Index = NDArray[np.int64]
Rows = NDArray[np.int32]  # tables have fewer

HISTORIES: Mapping[str, int] = MappingProxyType({"observations": 0, "evidence": 0, "actors": 0, "controls": -1})
"""Streams whose rows up to a tick are compared, as up to ``t_b``, and the offset of the last such row from it."""

_OF_MOMENTS = ("observations", "evidence", "actors")
"""Streams that tell of moments, whose copies are looked for."""

_CONTEXT = ("town", "route_x_m", "route_y_m", "ego_length_m", "ego_width_m", "ego_height_m", "branch_tick")
"""What rules on observations read of an attempt."""


class Copied(NamedTuple):
    """Rows of a stream that are copies, and the rows of nominals that they copy, which are none; both ``[copies]``."""

    row: Rows
    source: Rows

    def source_of(self, row: int) -> int:
        """What a row copies; itself where it is no copy."""
        (place,) = np.nonzero(self.row == row)
        return int(self.source[place[0]]) if len(place) else row

    def judged(self, num_rows: int) -> Mask:
        """Rows that are no copies ``[rows]``."""
        found = np.ones(num_rows, bool)
        found[self.row] = False
        return found

    def fill(self, *found: NDArray[Any]) -> None:
        """Give copies what was found of their sources, in place; each is ``[rows]``."""
        for values in found:
            values[self.row] = values[self.source]

    def distinct(self, row: NDArray[np.integer], before: NDArray[np.integer], num_rows: int) -> tuple[Index, Index]:
        """Steps from a row to another that repeat none of a source, and the one of them that each step is or repeats.

        Args:
            row: Rows that steps lead to, each once ``[steps]``.
            before: Rows that they come from ``[steps]``.
            num_rows: Rows of the stream.

        Returns:
            Places of the distinct steps ``[distinct]``, and for every step a place among these ``[steps]``.
        """
        source, before_of = np.arange(num_rows, dtype=np.int32), np.full(num_rows, -1, np.int32)  # tables have fewer
        source[self.row] = self.source
        before_of[row] = before
        of_row, of_before = source[row], source[before]
        repeats = (of_row != row) & (of_before != before) & (before_of[of_row] == of_before)
        first = np.flatnonzero(~repeats)
        place = before_of
        place[row[first]] = np.arange(len(first))
        return first, place[np.where(repeats, of_row, row)].astype(np.int64)


class Copies:
    """Copies of a shard, looked for when they are first asked for; see `ShardView.cached`.

    Args:
        view: The shard.
    """

    def __init__(self, view: ShardView) -> None:
        self._view: ShardView = proxy(view)  # which keeps this: a cycle would keep tables until they are collected
        self._rows: dict[str, Copied] = {}
        self._at_moments: dict[str, Copied] = {}

    def rows(self, table: str) -> Copied:
        """Copies among the rows of a stream, compared attempt by attempt in the order of their keys."""
        if table in self._rows:
            return self._rows[table]
        found = _copied(self._view, self._view.stream(table), HISTORIES[table])
        if table in _OF_MOMENTS:  # others are asked for once
            self._rows[table] = found
        return found

    def at_moments(self, table: str) -> Copied:
        """Those of observations, evidence or actors, at moments that are copies as a whole.

        All that is recorded at such an observation, of the ego and of others, is what the nominal holds of it, and so
        is what rules on observations read of the attempt.
        """
        if table not in self._at_moments:
            self._at_moments[table] = self._moments() if table == "observations" else self._rows_of_moments(table)
        return self._at_moments[table]

    def repeat(self, table: str, attempts: Index, last_tick: Index) -> Mask:
        """Whether attempts have up to a tick as many rows of a stream as their nominals, all copies ``[n]``.

        Of controls, rows before the tick count, which act up to it.
        """
        view, stream = self._view, self._view.stream(table)
        last = last_tick + HISTORIES[table]
        start, (_, stop) = stream.start[attempts], stream.span(attempts, last)
        nominal = view.nominal[attempts]
        num_expected = stream.span(nominal, last)[1] - stream.start[nominal]
        others = np.append(self.rows(table).judged(len(stream)), False)
        num_others = np.add.reduceat(others, np.stack([start, stop], axis=1).ravel(), dtype=np.int64)[::2]
        return np.asarray((stop - start == num_expected) & ((num_others == 0) | (num_expected == 0)))

    def _moments(self) -> Copied:
        view, observations = self._view, self._view.observations
        row, source = self.rows("observations")
        if observations.repeats.any() or not len(row):
            return Copied(row[:0], source[:0])
        kept = _shares_context(view)[observations.rollout[row]]
        for table in ("evidence", "actors"):
            if table in view and len(view.stream(table)):
                stream = view.stream(table)
                frame = observations.rows_of_moments(stream)
                num_rows, num_others = np.zeros((2, len(observations) + 1), np.int64)  # the last of no observation
                num_rows[frame] = stream.rows_at_moments
                num_others[frame] = np.add.reduceat(
                    self.rows(table).judged(len(stream)), stream.moments, dtype=np.int64
                )
                kept &= (num_rows[row] == num_rows[source]) & (num_others[row] == 0)
        return _where(kept, row, source)

    def _rows_of_moments(self, table: str) -> Copied:
        observations, (row, source) = self._view.observations, self.rows(table)
        is_whole = ~np.append(self.at_moments("observations").judged(len(observations)), True)
        kept = is_whole[observations.rows_of(self._view.stream(table))[row]]
        return _where(kept, row, source)


def _where(kept: Mask, row: Rows, source: Rows) -> Copied:
    """The copies that are kept; where all are, what there is is not copied."""
    return Copied(row, source) if kept.all() else Copied(row[kept], source[kept])


def _copied(view: ShardView, stream: StreamView, last_offset: int) -> Copied:
    """Copies in a stream: those of interventions up to the last offset from the branch, and those of replays."""
    intervenes, is_nominal, nominal = view.role("intervention"), view.role("nominal"), view.nominal
    repeats = (intervenes & view.branched) | view.role("nominal_replay")
    own = np.flatnonzero(repeats & (nominal >= 0) & is_nominal[nominal])
    last = np.where(intervenes[own], view.branch_tick[own] + last_offset, np.iinfo(np.int32).max)
    both = own, nominal[own]
    first = [stream.start[attempts] for attempts in both]
    count = np.minimum(*(stream.span(attempts, last)[1] - start for attempts, start in zip(both, first, strict=True)))
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row, source = (np.repeat(start, count) + place for start in first)
    if (order := _order(stream)) is not None:
        row, source = order[row], order[source]
    for column in TABLES[stream.name].columns[1:]:  # the first names the attempt
        if not len(row):
            break
        differs = stream.differs(column.name, row, source)
        if differs.any():
            row, source = row[~differs], source[~differs]
    return Copied(row.astype(np.int32), source.astype(np.int32))


def _order(stream: StreamView) -> NDArray[np.intp] | None:
    """Order of rows by their keys, ``None`` where they have it: the order in a file carries no meaning."""
    further = [stream[column] for column in TABLES[stream.name].key[2:]]
    if not further or stream.ascends:
        return None
    return np.lexsort((*further[::-1], stream.tick, stream.rollout))


def _shares_context(view: ShardView) -> Mask:
    """Attempts that have, bit for bit, what rules on observations read of their nominals ``[rollouts]``."""
    rollouts, shares = view.rollouts, view.nominal >= 0
    for column in _CONTEXT:
        if TABLES["rollouts"][column].type.startswith("list"):
            codes = rollouts.cells(column)
            shares &= codes == codes[view.nominal]
        else:
            shares &= ~rollouts.differs(column, np.arange(len(rollouts)), view.nominal)
    return shares
