"""Defects and limits of drives: whose decisions are recorded, and what was commanded after them."""

from __future__ import annotations

from typing import Any

from tests.synthetic import BRANCH_TICK, NUM_TICKS, STRIDE, WINDOW_TICKS
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.policy import ACTUATORS

BRAKES = "g0.drive-brake_0.50.a1"
ACCELERATES = "g0.drive-accelerate_0.50.a1"
"""A drive that steers left, by a policy that copies the pedals, as soon as it has accelerated."""

STEERS = "g0.drive-steer_left_0.10.a1"
"""A drive that steers left at the branch, right 25 ticks later, and then leaves the wheel to the expert."""

SECOND, THIRD = BRANCH_TICK + 25, BRANCH_TICK + 60
"""Its later decisions."""

LAST = BRANCH_TICK + WINDOW_TICKS - 1


def _decision(rollout_id: str, tick: int, column: str = "tick") -> dict[str, Any]:
    return {"table": "decisions", "column": column, "rollout_id": rollout_id, "tick": tick}


def _command(rollout_id: str, column: str, tick: int) -> dict[str, Any]:
    return {"table": "controls", "column": column, "rollout_id": rollout_id, "tick": tick}


def _of(kind: str) -> tuple[str, ...]:
    return tuple(f"{kind}_{actuator}" for actuator in ACTUATORS)


def _leave_to_the_expert(d: Draft, rollout_id: str, ticks: range) -> None:
    """Let the online expert drive at ticks that a policy was active at, consistently."""
    d.set("controls", "active", False, rollout_id=rollout_id, tick=ticks)
    d.set("controls", "source", "online_expert", rollout_id=rollout_id, tick=ticks)
    d.set("controls", (*_of("nominal"), *_of("intended")), None, rollout_id=rollout_id, tick=ticks)
    rows = d.take("controls", rollout_id=rollout_id, tick=ticks)
    columns = {f"applied_{actuator}": rows[f"expert_{actuator}"].to_numpy() for actuator in ACTUATORS}
    d.fill("controls", columns, rollout_id=rollout_id, tick=ticks)


# BD-KEY-009


@mutant("BD-KEY-009", at=_decision(STEERS, SECOND + 1))
def decision_between_observations(d: Draft) -> None:
    d.set("decisions", "tick", SECOND + 1, rollout_id=STEERS, tick=SECOND)


@mutant("BD-KEY-009", at=_decision(STEERS, NUM_TICKS + STRIDE))
def decision_after_the_end(d: Draft) -> None:
    d.set("decisions", "tick", NUM_TICKS + STRIDE, rollout_id=STEERS, tick=THIRD)


@mutant("BD-KEY-009", at=_decision(STEERS, SECOND))
def two_decisions_at_once(d: Draft) -> None:
    d.duplicate("decisions", {"action_key": "brake_0.50"}, rollout_id=STEERS, tick=SECOND)


@mutant("BD-KEY-009", at=_decision("g0.nominal.a1", BRANCH_TICK))
def decision_of_a_nominal_rollout(d: Draft) -> None:
    d.duplicate("decisions", {"rollout_id": "g0.nominal.a1"}, rollout_id=BRAKES)


@mutant("BD-KEY-009", at=_decision(STEERS, THIRD, "action_key"))
def decision_for_a_policy_that_the_bank_lacks(d: Draft) -> None:
    d.set("decisions", "action_key", "coast", rollout_id=STEERS, tick=THIRD)


@mutant("BD-KEY-009", at={"table": "rollouts", "column": "action_key", "rollout_id": BRAKES})
def first_decision_after_the_branch(d: Draft) -> None:
    d.set("decisions", "tick", BRANCH_TICK + STRIDE, rollout_id=BRAKES)


@mutant("BD-KEY-009", at={"table": "rollouts", "column": "action_key", "rollout_id": BRAKES})
def decision_before_the_branch(d: Draft) -> None:
    d.duplicate("decisions", {"tick": BRANCH_TICK - STRIDE}, rollout_id=BRAKES)


@mutant("BD-KEY-009", at={"table": "rollouts", "column": "action_key", "rollout_id": BRAKES})
def first_decision_for_another_policy(d: Draft) -> None:
    d.set("decisions", "action_key", "brake_0.30", rollout_id=BRAKES)


@mutant("BD-KEY-009", at={"table": "rollouts", "column": "action_key", "rollout_id": BRAKES})
def drive_without_a_decision(d: Draft) -> None:
    d.drop("decisions", rollout_id=BRAKES)


@mutant("BD-KEY-009", at={"table": "rollouts", "column": "role", "rollout_id": BRAKES}, findings=2)
def intervention_among_drives(d: Draft) -> None:
    d.set("rollouts", "role", "intervention", rollout_id=BRAKES)


@boundary("BD-KEY-009", "BD-CTL-016")
def decisions_at_the_last_observation_and_at_the_next_after_another(d: Draft) -> None:
    for tick in (THIRD + STRIDE, NUM_TICKS - NUM_TICKS % STRIDE - STRIDE * (NUM_TICKS % STRIDE == 0)):
        d.duplicate("decisions", {"tick": tick}, rollout_id=STEERS, tick=THIRD)


# BD-CTL-016


@mutant("BD-CTL-016", at=_command(BRAKES, "active", LAST))
def window_shorter_than_decided(d: Draft) -> None:
    _leave_to_the_expert(d, BRAKES, range(LAST, LAST + 1))


@mutant("BD-CTL-016", at=_command(STEERS, "active", THIRD))
def window_that_a_later_decision_ends(d: Draft) -> None:
    d.drop("decisions", rollout_id=STEERS, tick=THIRD)


@mutant("BD-CTL-016", at=_command(STEERS, "active", SECOND))
def later_decision_that_was_not_carried_out(d: Draft) -> None:
    _leave_to_the_expert(d, STEERS, range(SECOND, THIRD))


@mutant("BD-CTL-016", at=_command(STEERS, "intended_steer", SECOND))
def earlier_policy_after_a_later_decision(d: Draft) -> None:
    d.set("controls", ("intended_steer", "applied_steer"), -0.1, rollout_id=STEERS, tick=range(SECOND, SECOND + 5))


@mutant("BD-CTL-016", at=_command(ACCELERATES, "nominal_brake", LAST + 1))
def stored_trace_after_a_later_decision(d: Draft) -> None:
    ticks = range(LAST + 1, LAST + 1 + WINDOW_TICKS)
    stored = d.take("controls", rollout_id="g0.nominal.a1", tick=ticks)
    kinds = ("nominal", "intended", "applied")
    for pedal in ("throttle", "brake"):
        columns = {f"{kind}_{pedal}": stored[f"applied_{pedal}"].to_numpy() for kind in kinds}
        d.fill("controls", columns, rollout_id=ACCELERATES, tick=ticks)


@mutant("BD-CTL-016", at=_command(BRAKES, "nominal_throttle", BRANCH_TICK + 10))
def stored_trace_of_nobody_after_the_first_decision(d: Draft) -> None:
    d.set("controls", "nominal_throttle", 0.875, rollout_id=BRAKES, tick=BRANCH_TICK + 10)


@mutant("BD-CTL-016", at=_command(BRAKES, "applied_brake", BRANCH_TICK + 10))
def command_that_did_not_reach_the_vehicle(d: Draft) -> None:
    d.set("controls", "applied_brake", 0.4375, rollout_id=BRAKES, tick=BRANCH_TICK + 10)


@boundary("BD-CTL-016")
def commands_of_a_drive_within_the_tolerance(d: Draft) -> None:
    d.descriptor["tolerances"] = {"actuator": 0.01}
    d.set("controls", "applied_brake", lambda brake: brake - 0.0078125, rollout_id=BRAKES, tick=BRANCH_TICK + 10)
