"""Decision rules: whose decisions are recorded, and that a drive was commanded as they say.

The policy of a drive's latest decision, made at ``t_d``, is active exactly for ``t_d <= t < t_d + T`` with its duration
``T``, and the online expert drives at all other ticks. Source: spec/04-policies.md#drives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import DECISIONS
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.policy import ACTUATORS
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.shard_view import ShardView

Rows = NDArray[np.int64]


@rule("BD-KEY-009")
def decisions_are_those_of_drives(view: ShardView) -> Iterator[Check]:
    """Attempts are drives and nominal rollouts; drives decide at saved observations, first at ``t_b`` by their key."""
    decisions, drives = view.stream(DECISIONS), view.role("drive")
    roles = np.flatnonzero(~drives & ~view.role("nominal"))
    yield Check.of_rows(
        "rollouts", "role", view.num_rollouts, roles,
        lambda row: ("`drive` or `nominal`", quote(view.rollouts["role"][row])),
    )  # fmt: skip

    known = decisions.rollout >= 0
    is_lost = known & ~(np.append(drives, False)[decisions.rollout] & (view.observations.rows_of(decisions) >= 0))
    yield Check.of_rows(
        DECISIONS, "tick", len(decisions), np.flatnonzero(known & (is_lost | decisions.repeats)),
        lambda row: (
            "one decision of a drive at a saved observation",
            "no such observation" if is_lost[row] else "a second decision",
        ),
    )  # fmt: skip

    keys = decisions["action_key"]
    is_unknown = decisions.valid("action_key") & (_policies(view) < 0)
    yield Check.of_rows(
        DECISIONS, "action_key", len(decisions), np.flatnonzero(is_unknown),
        lambda row: ("an action key of the bank", quote(keys[row])),
    )  # fmt: skip

    first = np.where(decisions.is_there, decisions.start, -1)
    ticks, named = np.append(decisions.tick, -1)[first], np.append(keys, "")[first]
    is_first = view.branched & (ticks == view.branch_tick) & (named == view.rollouts["action_key"])

    def begins(row: int) -> tuple[str, str]:
        branch = f"at tick {view.branch_tick[row]}" if view.branched[row] else "and a branch"
        wanted = f"a first decision {branch}, by {quote(view.rollouts['action_key'][row])}"
        return wanted, f"one at tick {ticks[row]}, by {quote(named[row])}" if first[row] >= 0 else "no decision"

    yield Check.of_rows("rollouts", "action_key", int(drives.sum()), np.flatnonzero(drives & ~is_first), begins)


def _policies(view: ShardView) -> Rows:
    """Policy of each decision, index into the bank; -1 if the bank lacks its action key."""
    place = {key: index for index, key in enumerate(view.descriptor.action_bank.keys)}
    return np.array([place.get(key, -1) for key in view.stream(DECISIONS)["action_key"]], np.int64)


@dataclass
class _Commanded:
    """Where control rows of drives depart from what was decided: the first column of each row that is wrong.

    Attributes:
        column: Its name; empty where the row is right ``[rows]``.
        expected: What it should hold ``[rows]``.
    """

    column: NDArray[np.object_]
    expected: NDArray[np.object_] = field(init=False)

    def __post_init__(self) -> None:
        self.expected = np.full(len(self.column), None, object)

    def refuse(self, column: str, rows: Rows, expected: NDArray[np.generic]) -> None:
        """Rows whose column should hold something else, unless an earlier column of theirs is wrong."""
        fresh = self.column[rows] == ""
        self.column[rows[fresh]], self.expected[rows[fresh]] = column, list(expected[fresh])


@rule("BD-CTL-016")
def drives_are_commanded_as_decided(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Active, stored, intended and applied commands of every tick are those of the drive's latest decision.

    What a policy copies is the nominal rollout's command of the tick after the first decision, and the online expert's
    after later ones.
    """
    controls, decisions = view.controls, view.stream(DECISIONS)
    subjects = subjects & view.role("drive") & controls.is_there
    rows = np.flatnonzero(np.append(subjects, False)[controls.rollout])
    owner, tick, bank = controls.rollout[rows], controls.tick[rows], view.descriptor.action_bank
    latest = decisions.span(owner, tick)[1] - 1
    is_decided = latest >= decisions.start[owner]
    policy = np.where(is_decided, np.append(_policies(view), -1)[latest], -1)
    durations = np.array([one.duration_ticks for one in bank.policies] + [0])
    is_active = is_decided & (tick < np.append(decisions.tick, 0)[latest] + durations[policy])
    found = _Commanded(np.full(len(controls), "", object))
    wrong = is_active != controls["active"][rows]
    found.refuse("active", rows[wrong], is_active[wrong])

    here, owner, tick, policy = rows[is_active], owner[is_active], tick[is_active], policy[is_active]
    is_first = latest[is_active] == decisions.start[owner]
    source = controls.find(view.nominal[owner], tick)
    tolerance = view.descriptor.tolerances.actuator
    for actuator_index, actuator in enumerate(ACTUATORS):
        expert = controls[f"expert_{actuator}"][here]
        nominal = np.append(controls[f"applied_{actuator}"], np.float32(np.nan))[
            source
        ]  # NaN where it has no such tick
        stored = np.where(is_first, nominal, expert)
        demanded = np.zeros(len(here), np.float32)
        for index, one in enumerate(bank.policies):
            of_policy = policy == index
            demanded[of_policy] = one.rules[actuator_index].evaluate(expert[of_policy], stored[of_policy])
        for column, wanted, most in (
            (f"nominal_{actuator}", stored, 0.0),
            (f"intended_{actuator}", demanded, 0.0),
            (f"applied_{actuator}", demanded, tolerance),
        ):
            values = controls[column][here]
            off = values != wanted if most == 0 else ~(np.abs(values.astype(float) - wanted) <= most)
            found.refuse(column, here[off], wanted[off])
    summary = controls.by_rollout(found.column != "")

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        column, at = str(found.column[row]), int(controls.tick[row])
        decided = int(decisions.span(np.array([i]), np.array([at]))[1][0]) - 1
        made = (
            f"{quote(decisions['action_key'][decided])} of tick {decisions.tick[decided]}"
            if decided >= decisions.start[i]
            else "no decision yet"
        )
        wanted = found.expected[row]
        expected = f"{'a command that the nominal rollout lacks' if wanted != wanted else quote(wanted)} ({made})"
        place: Location = {"table": "controls", "column": column, "tick": at}
        return Mismatch(place, expected, quote(controls[column][row]), int(summary.count[i]))

    yield Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)
