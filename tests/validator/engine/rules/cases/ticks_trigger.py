"""Defects and limits of trigger evidence."""

from __future__ import annotations

import numpy as np
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft


def _place(column: str, rollout_id: str = BRAKE) -> dict[str, str]:
    return {"table": "rollouts", "column": column, "rollout_id": rollout_id}


@mutant("BD-TRG-001", at=_place("trigger_rollout_id"))
def trigger_read_from_the_intervention(d: Draft) -> None:
    d.set("rollouts", "trigger_rollout_id", BRAKE, rollout_id=BRAKE)


@mutant("BD-TRG-001", at=_place("trigger_rollout_id", NOMINAL))
def trigger_read_from_a_replay(d: Draft) -> None:
    d.set("rollouts", "trigger_rollout_id", REPLAY, rollout_id=NOMINAL)


@boundary("BD-TRG-001", "BD-TRG-002", "BD-TRG-003")
def trigger_at_the_branch(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", BRANCH_TICK, group_id="g0")
    d.set("rollouts", "trigger_signal", "lane_shift", group_id="g0")


@mutant("BD-TRG-002", at=_place("trigger_tick"))
def trigger_before_the_branch(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", BRANCH_TICK - 1, rollout_id=BRAKE)


@mutant("BD-TRG-002", at=_place("trigger_tick"))
def trigger_after_the_nominal_ended(d: Draft) -> None:
    d.set("rollouts", "trigger_tick", 201, rollout_id=BRAKE)


# BD-TRG-003


def _show(d: Draft, signal: str, tick: int, threshold: float | None = None) -> None:
    """Make the command of the group's nominal at `tick` its trigger, at its threshold unless there is another."""
    value = d.value("controls", COMMANDS[signal], rollout_id=NOMINAL, tick=tick)
    changes = {
        "trigger_tick": tick, "trigger_signal": signal, "trigger_value": value,
        "trigger_threshold": value if threshold is None else threshold,
    }  # fmt: skip
    for column, change in changes.items():
        d.set("rollouts", column, change, group_id="g0")


COMMANDS = {"brake": "expert_brake", "throttle_release": "expert_throttle", "steer": "expert_steer"}


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def value_that_the_nominal_does_not_show(d: Draft) -> None:
    d.set("rollouts", "trigger_value", lambda v: v + 0.001, group_id="g0")


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def brake_below_its_threshold(d: Draft) -> None:
    _show(d, "brake", BRANCH_TICK + 20, threshold=0.99)


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def throttle_above_its_threshold(d: Draft) -> None:
    _show(d, "throttle_release", BRANCH_TICK + 10, threshold=0.0)


@mutant("BD-TRG-003", at=_place("trigger_tick"), findings=15)
def trigger_long_after_the_branch(d: Draft) -> None:
    _show(d, "brake", BRANCH_TICK + 21)


def _just_beyond(value: float, limit: float) -> float:
    """The next value of a column beside `value`, on the way to `limit`."""
    return float(np.nextafter(np.float32(value), np.float32(limit)))


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def brake_a_rounding_below_its_threshold(d: Draft) -> None:
    tick = BRANCH_TICK + 20
    value = d.value("controls", COMMANDS["brake"], rollout_id=NOMINAL, tick=tick)
    _show(d, "brake", tick, threshold=_just_beyond(value, 1.0))


def _hold(d: Draft, tick: int, *, more: float = 0.0, above: float = 0.0) -> None:
    """Make the group's branch a control, with a value that is `more` than the change and `above` the threshold."""
    rows = d.take("controls", rollout_id=NOMINAL, tick=range(tick, tick + 50)).sort_by("tick")
    commands = np.array([rows[column].to_numpy() for column in COMMANDS.values()], np.float64)
    value = np.abs(commands - commands[:, :1]).max() + more
    changes = {
        "trigger_tick": tick, "trigger_signal": "steady", "trigger_value": value, "trigger_threshold": value - above,
    }  # fmt: skip
    for column, change in changes.items():
        d.set("rollouts", column, change, group_id="g0")


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def control_at_which_commands_change_more(d: Draft) -> None:
    _hold(d, BRANCH_TICK, more=-0.001)


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def control_above_its_threshold(d: Draft) -> None:
    _hold(d, BRANCH_TICK, above=0.001)


@mutant("BD-TRG-003", at=_place("trigger_value"), findings=15)
def control_a_rounding_above_its_threshold(d: Draft) -> None:
    _hold(d, BRANCH_TICK)
    value = d.value("rollouts", "trigger_value", rollout_id=NOMINAL)
    d.set("rollouts", "trigger_threshold", _just_beyond(value, -1.0), group_id="g0")


@mutant("BD-TRG-003", at=_place("trigger_tick"), findings=15)
def control_behind_the_branch(d: Draft) -> None:
    _hold(d, BRANCH_TICK + 1)


@boundary("BD-TRG-003")
def control_at_its_threshold(d: Draft) -> None:
    _hold(d, BRANCH_TICK)


@boundary("BD-TRG-003")
def throttle_at_its_threshold(d: Draft) -> None:
    _show(d, "throttle_release", BRANCH_TICK + 20)


@boundary("BD-TRG-003")
def steer_at_its_threshold(d: Draft) -> None:
    _show(d, "steer", BRANCH_TICK + 10)


# Several places: what violates a rule is counted


@mutant("BD-TRG-001", at={"rollout_id": FURTHER}, findings=2, lost=2)
def triggers_read_from_two_interventions(d: Draft) -> None:
    for rollout_id in BOTH:
        d.set("rollouts", "trigger_rollout_id", rollout_id, rollout_id=rollout_id)
