"""A branch group as arrays: one decision context with all its executed futures.

Windows are relative to the rollout's own branch tick ``t_b``. Source: paper, "Branch-Group Representation" and
"Two-Pass Collection"; spec/02-time-frames-units.md#windows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Never

import numpy as np

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.resources import load_resource
from branchdrive.contract.text import nearest, quote
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS
from branchdrive.errors import UnknownNameError, UsageError
from branchdrive.raw.outcomes import RESULTS, outcomes
from branchdrive.raw.rollout import ROLLOUTS, Rollout
from branchdrive.tables.data_frame import to_pandas, to_polars
from branchdrive.text.html import html_of
from branchdrive.text.table import Column, Table

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["APPLIED_CONTROLS", "STATE_COLUMNS", "BranchGroup"]

APPLIED_CONTROLS = ("applied_steer", "applied_throttle", "applied_brake")
"""The command that reached the vehicle; steering is positive to the right."""

STATE_COLUMNS = tuple(
    column.name
    for column in TABLES["observations"].columns
    if column.track == "sensor" and column.type.startswith("float")
)
"""Numeric columns of the sensor track, in declared order."""

_Array = np.ndarray[Any, np.dtype[Any]]


class Interventions(dict[str, tuple[Rollout, ...]]):
    """Attempts of every executed intervention by action key."""

    def __missing__(self, key: str) -> Never:
        raise UnknownNameError(f"no intervention {quote(key)} in this group; {nearest(key, self)}")


@dataclass(frozen=True, repr=False)
class BranchGroup:
    """All attempts of one decision context.

    Attributes:
        group_id: Identity of the group.
        rollouts: Every attempt: nominal, interventions in the order of the action bank, nominal replays.
    """

    group_id: str
    rollouts: tuple[Rollout, ...]

    @property
    def nominal(self) -> Rollout:
        """The nominal rollout: of several, the first complete attempt, else the first attempt.

        Raises:
            UsageError: The group has none.
        """
        nominals = self._of_role("nominal")
        if not nominals:
            raise UsageError(f"group `{self.group_id}` has no nominal rollout; look at `rollouts`")
        return _first_complete(nominals)

    @property
    def interventions(self) -> Interventions:
        """Attempts of every executed intervention by action key, in the order of the action bank."""
        attempts = Interventions()
        for rollout in self._of_role("intervention"):
            key = rollout.record["action_key"]
            attempts[key] = (*attempts.get(key, ()), rollout)
        return attempts

    @property
    def candidates(self) -> dict[str, Rollout]:
        """One attempt for each policy by action key, the nominal first: the first complete attempt, else the first.

        No attempt is judged here: which one stands for its action in a release is in the table `records`.

        Raises:
            UsageError: The group has no nominal rollout.
        """
        chosen = {key: _first_complete(attempts) for key, attempts in self.interventions.items()}
        return {self.nominal.record["action_key"]: self.nominal, **chosen}

    def outcomes(self) -> pa.Table:
        """What became of each of the `candidates`: how its drive went, and the six targets of its window.

        A target is null where it is not available. Nothing is ranked here: utility weighs targets by the spread that
        they have in training, see `ModelLayer.outcomes`.
        """
        return outcomes([*self.candidates.values()])

    def table(self, name: str) -> pa.Table:
        """Rows of a stream of all attempts, each with the role, the action and the number of its attempt before it.

        Raises:
            UnknownNameError: The dataset does not claim a stream with this table.
        """
        import pyarrow as pa

        return pa.concat_tables([_labelled(rollout, rollout.tables[name]) for rollout in self.rollouts])

    def to_pandas(self, table: str) -> Any:
        """A stream of all attempts as a `pandas.DataFrame`, see `table`."""
        return to_pandas(self.table(table))

    def to_polars(self, table: str) -> Any:
        """A stream of all attempts as a `polars.DataFrame`, see `table`."""
        return to_polars(self.table(table))

    @property
    def replays(self) -> tuple[Rollout, ...]:
        """Independent further executions of the nominal policy."""
        return self._of_role("nominal_replay")

    @property
    def drives(self) -> tuple[Rollout, ...]:
        """Attempts with a decision or several, in a dataset of drives."""
        return self._of_role("drive")

    @property
    def _roles(self) -> tuple[str, ...]:
        """Roles that its attempts can have."""
        return ("nominal", "drive") if self.drives else ("nominal", "intervention", "nominal_replay")

    def _of_role(self, role: str) -> tuple[Rollout, ...]:
        return tuple(rollout for rollout in self.rollouts if rollout.record["role"] == role)

    def history_observations(self, rollout: Rollout, columns: Sequence[str] = STATE_COLUMNS) -> _Array:
        """Observations at ``t_b - 75, t_b - 70, .., t_b``, shape ``[16, columns]``, float64.

        Raises:
            UsageError: The rollout has no branch or lacks one of these rows, or a column is not numeric.
        """
        return _window(rollout, "observations", HISTORY_OFFSETS, columns)

    def future_observations(self, rollout: Rollout, columns: Sequence[str] = STATE_COLUMNS) -> _Array:
        """Observations at ``t_b + 5, .., t_b + 50``, shape ``[10, columns]``, float64; errors as above."""
        return _window(rollout, "observations", FUTURE_OFFSETS, columns)

    def control_history(self, rollout: Rollout) -> _Array:
        """Applied steer, throttle and brake at ``t_b - 80 .. t_b - 1``, shape ``[80, 3]``, float32; errors as above."""
        return _window(rollout, "controls", range(-CONTROL_HISTORY_TICKS, 0), APPLIED_CONTROLS)

    def controls(self, rollout: Rollout, columns: Sequence[str] = APPLIED_CONTROLS) -> _Array:
        """Controls of all ticks, shape ``[ticks, columns]``, float32; masked where a chosen column may be null.

        Raises:
            UsageError: A column is not numeric.
        """
        return _matrix(rollout, "controls", columns)

    def record(self) -> dict[str, Any]:
        """The group as its record schema has it: values shared by the group, and its attempts.

        The shared values are those of the nominal rollout.

        Raises:
            UsageError: The group has no nominal rollout.
        """
        declared = load_resource("columns.json")["records"]["branch_group"]
        shared = {name: self.nominal.record[name] for name in declared["shared"]}
        attempts = [{name: r.record[name] for name in declared["attempts"]} for r in self.rollouts]
        return {**shared, "attempts": attempts}

    def _repr_html_(self) -> str:
        counts = Counter(rollout.record["role"] for rollout in self.rollouts)
        facts = [(role.replace("_", " "), str(count)) for role, count in counts.items()]
        context = self.nominal.record if self._of_role("nominal") else {}
        named = [(name, str(context.get(name, ""))) for name in ("scenario_type", "town", "route_id", "branch_tick")]
        columns = [Column.name(name) for name in ("action_key", "status", *RESULTS)]
        rows = [[str(rollout.record[column.title]) for column in columns] for rollout in self.rollouts]
        return html_of(f"BranchGroup {self.group_id}", [*named, *facts], [Table("Attempts", columns, rows)])

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(self._of_role(role))} {role}" for role in self._roles)
        lines = [f"BranchGroup({self.group_id!r}: {counts}; {len(self.interventions)} actions)"]
        for rollout in self.rollouts:
            shapes = [f"{name} {list(_shape(rollout, name))}" for name in rollout.tables]
            lines.append(f"  {rollout.rollout_id!r} t_b={rollout.branch_tick}: {', '.join(shapes)}")
        width = len(STATE_COLUMNS)
        windows = f"history [16, {width}] float64, controls [80, 3] float32, future [10, {width}] float64"
        return "\n".join([*lines, f"  windows: {windows}"])


def _first_complete(attempts: Sequence[Rollout]) -> Rollout:
    return next((attempt for attempt in attempts if attempt.record["status"] == "complete"), attempts[0])


def _labelled(rollout: Rollout, rows: pa.Table) -> pa.Table:
    """Rows of an attempt behind columns that say whose they are."""
    import pyarrow as pa

    labels = {name: rollout.record[name] for name in ("role", "action_key", "attempt")}
    for name, value in reversed(labels.items()):
        field = table_schema(ROLLOUTS).field(name)
        rows = rows.add_column(0, field, pa.repeat(pa.scalar(value, field.type), len(rows)))
    return rows


def _shape(rollout: Rollout, table: str) -> tuple[int, int]:
    return rollout.tables[table].num_rows, rollout.tables[table].num_columns


def _window(rollout: Rollout, table: str, offsets: Sequence[int], columns: Sequence[str]) -> _Array:
    """Rows of `table` at ``t_b + offsets``, shape ``[offsets, columns]``."""
    branch_tick = rollout.branch_tick
    if branch_tick is None:
        raise UsageError(f"rollout `{rollout.rollout_id}` has no branch tick and so no windows")
    wanted = np.asarray(offsets) + branch_tick
    ticks = rollout.column(table, "tick")
    first, after = (np.searchsorted(ticks, wanted, side=side) for side in ("left", "right"))
    unusable = wanted[after - first != 1]
    if unusable.size:
        raise UsageError(
            f"rollout `{rollout.rollout_id}` lacks or repeats {table} at ticks {unusable.tolist()}; "
            "only rollouts with whole windows have arrays"
        )
    return _matrix(rollout, table, columns)[first]


def _matrix(rollout: Rollout, table: str, columns: Sequence[str]) -> _Array:
    """Chosen columns side by side, shape ``[rows, columns]``: float64 for observations, float32 for controls."""
    declared = {column.name: column.type for column in TABLES[table].columns}
    unfit = [name for name in columns if declared.get(name, "string") == "string"]
    if unfit:
        numeric = [name for name, kind in declared.items() if kind != "string"]
        raise UsageError(f"columns {unfit} of `{table}` are not numeric; choose from {numeric}")
    values = [rollout.column(table, name) for name in columns]
    dtype = np.float32 if table == "controls" else np.float64
    if any(isinstance(value, np.ma.MaskedArray) for value in values):
        masked: _Array = np.ma.stack(values, axis=1).astype(dtype)
        return masked
    return np.stack(values, axis=1).astype(dtype)
