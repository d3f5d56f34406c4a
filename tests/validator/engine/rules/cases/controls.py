"""Defects and limits of commands: the active window, the actuator algebra, what was applied, who drove."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from tests.synthetic import BRANCH_TICK, WINDOW_TICKS, make_group, plans
from tests.validator.engine.rules.case import (
    ACCELERATE,
    BOTH,
    BRAKE,
    FURTHER,
    NOMINAL,
    REPLAY,
    STEER_LEFT,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.columns import TICK_TABLES
from branchdrive.contract.policy import ActuatorRule, Policy

ACTUATORS = ("steer", "throttle", "brake")


MIDDLE = BRANCH_TICK + 10


LAST = BRANCH_TICK + WINDOW_TICKS - 1


def _place(rollout_id: str, tick: int) -> dict[str, str | int]:
    return {"table": "controls", "rollout_id": rollout_id, "tick": tick}


def _of(kinds: str, actuator: str) -> tuple[str, ...]:
    return tuple(f"{kind}_{actuator}" for kind in kinds.split())


def _activate(d: Draft, rollout_id: str, ticks: Iterable[int]) -> None:
    """Let the attempt's policy drive at some more ticks, consistently."""
    nominal_id = d.value("rollouts", "nominal_rollout_id", rollout_id=rollout_id) or rollout_id
    policy = load_action_bank()[d.value("rollouts", "action_key", rollout_id=rollout_id)]
    for tick in ticks:
        here: dict[str, Any] = {"rollout_id": rollout_id, "tick": tick}
        d.set("controls", "active", True, **here)
        d.set("controls", "source", "intervention", **here)
        for actuator in ACTUATORS:
            stored = d.value("controls", f"applied_{actuator}", rollout_id=nominal_id, tick=tick)
            expert = d.value("controls", f"expert_{actuator}", **here)
            rule: ActuatorRule = getattr(policy, actuator)
            command = {
                "online_expert": expert, "stored_nominal": stored, "zero": 0.0, "absolute": rule.value,
                "floor": max(expert, float(np.float32(rule.value or 0))),
            }[rule.rule]  # fmt: skip
            d.set("controls", f"nominal_{actuator}", stored, **here)
            d.set("controls", _of("intended applied", actuator), command, **here)


def _deactivate(d: Draft, rollout_id: str, ticks: Iterable[int]) -> None:
    """Let the online expert drive at some ticks of the window, consistently."""
    for tick in ticks:
        here: dict[str, Any] = {"rollout_id": rollout_id, "tick": tick}
        d.set("controls", "active", False, **here)
        d.set("controls", "source", "online_expert", **here)
        for actuator in ACTUATORS:
            d.set("controls", _of("nominal intended", actuator), None, **here)
            d.set("controls", f"applied_{actuator}", d.value("controls", f"expert_{actuator}", **here), **here)


def _small_bank(**changes: Any) -> ActionBank:
    """The nominal policy and one brake policy with some other properties."""
    brake = load_action_bank()["brake_0.50"]
    return ActionBank(name="small", policies=(load_action_bank().nominal, brake.model_copy(update=changes)))


def _drive_bank(d: Draft, bank: ActionBank, *, branch_tick: int = BRANCH_TICK, num_ticks: int = 201) -> None:
    planned = plans(0, bank, branch_tick)
    d.replace_bank(bank, make_group(0, planned, bank=bank, num_ticks=num_ticks))


# BD-CTL-001


@mutant("BD-CTL-001", at=_place(BRAKE, BRANCH_TICK - 1))
def active_one_tick_too_early(d: Draft) -> None:
    _activate(d, BRAKE, [BRANCH_TICK - 1])


@mutant("BD-CTL-001", at=_place(STEER_LEFT, 0))
def active_from_the_start(d: Draft) -> None:
    _activate(d, STEER_LEFT, [0, 1])


# BD-CTL-002


@mutant("BD-CTL-002", at={"table": "controls", "column": "active", "rollout_id": BRAKE})
def window_longer_by_a_tick(d: Draft) -> None:
    _activate(d, BRAKE, [LAST + 1])


@mutant("BD-CTL-002", at={"table": "controls", "column": "active", "rollout_id": BRAKE})
def window_shorter_by_a_tick(d: Draft) -> None:
    _deactivate(d, BRAKE, [LAST])


@mutant("BD-CTL-002", at={"table": "controls", "column": "active", "rollout_id": BRAKE})
def window_later_by_a_tick(d: Draft) -> None:
    _deactivate(d, BRAKE, [BRANCH_TICK])
    _activate(d, BRAKE, [LAST + 1])


@mutant("BD-CTL-002", at={"table": "controls", "column": "active", "rollout_id": BRAKE})
def window_with_a_gap_made_up_later(d: Draft) -> None:
    _deactivate(d, BRAKE, [MIDDLE])
    _activate(d, BRAKE, [LAST + 20])


@mutant("BD-CTL-002", at={"table": "controls", "column": "active", "rollout_id": BRAKE})
def intervention_that_never_began(d: Draft) -> None:
    _deactivate(d, BRAKE, range(BRANCH_TICK, LAST + 1))


@boundary("BD-KEY-008", "BD-CTL-002", "BD-CTL-012", "BD-CTL-014")
def policy_of_one_tick(d: Draft) -> None:
    _drive_bank(d, _small_bank(duration_ticks=1))


@boundary("BD-CTL-002", "BD-CTL-010", "BD-CTL-012")
def policy_longer_than_the_window(d: Draft) -> None:
    _drive_bank(d, _small_bank(duration_ticks=70), num_ticks=171)


# BD-CTL-003 .. BD-CTL-007: the five rules of the algebra


@mutant("BD-CTL-003", at=_place(BRAKE, MIDDLE))
def steering_frozen_while_braking(d: Draft) -> None:
    d.set("controls", _of("intended applied", "steer"), 0.0, rollout_id=BRAKE, tick=MIDDLE)


@mutant("BD-CTL-003", at=_place(BRAKE, BRANCH_TICK))
def steering_in_double_precision(d: Draft) -> None:
    def neighbour(steer: float) -> float:
        return float(np.nextafter(np.float32(steer), np.float32(1)))

    d.set("controls", _of("intended applied", "steer"), neighbour, rollout_id=BRAKE, tick=range(BRANCH_TICK, LAST + 1))


def _other_throttle(d: Draft) -> float:
    """Throttle that the expert of an attempt which steers demands, and its nominal did not."""
    stored = d.value("controls", "nominal_throttle", rollout_id=STEER_LEFT, tick=MIDDLE)
    d.set("controls", "expert_throttle", stored + 0.125, rollout_id=STEER_LEFT, tick=MIDDLE)
    return float(stored) + 0.125


@mutant("BD-CTL-004", at=_place(STEER_LEFT, MIDDLE))
def online_throttle_while_steering(d: Draft) -> None:
    d.set("controls", _of("intended applied", "throttle"), _other_throttle(d), rollout_id=STEER_LEFT, tick=MIDDLE)


@mutant("BD-CTL-004", at=_place(STEER_LEFT, BRANCH_TICK))
def brake_of_the_tick_before(d: Draft) -> None:
    def more(brake: float) -> float:
        return brake + 0.25

    d.set("controls", _of("intended applied", "brake"), more, rollout_id=STEER_LEFT, tick=BRANCH_TICK)


@mutant("BD-CTL-005", at=_place(ACCELERATE, MIDDLE))
def online_steering_while_accelerating(d: Draft) -> None:
    expert = d.value("controls", "expert_steer", rollout_id=ACCELERATE, tick=MIDDLE)
    assert expert
    d.set("controls", _of("intended applied", "steer"), expert, rollout_id=ACCELERATE, tick=MIDDLE)


@mutant("BD-CTL-005", at=_place(BRAKE, LAST))
def throttle_creeps_while_braking(d: Draft) -> None:
    d.set("controls", _of("intended applied", "throttle"), 1e-30, rollout_id=BRAKE, tick=LAST)


@mutant("BD-CTL-006", at=_place(STEER_LEFT, MIDDLE))
def steering_flipped(d: Draft) -> None:
    d.set("controls", _of("intended applied", "steer"), lambda steer: -steer, rollout_id=STEER_LEFT, tick=MIDDLE)


@mutant("BD-CTL-006", at=_place(STEER_LEFT, BRANCH_TICK))
def steering_ramps_up(d: Draft) -> None:
    d.set("controls", _of("intended applied", "steer"), -0.05, rollout_id=STEER_LEFT, tick=BRANCH_TICK)


@mutant("BD-CTL-007", at=_place(BRAKE, BRANCH_TICK))
def brake_below_its_floor(d: Draft) -> None:
    d.set("controls", _of("intended applied", "brake"), 0.25, rollout_id=BRAKE, tick=BRANCH_TICK)


@mutant("BD-CTL-007", at=_place(BRAKE, MIDDLE))
def floor_replaces_a_harder_expert(d: Draft) -> None:
    d.set("controls", "expert_brake", 0.75, rollout_id=BRAKE, tick=MIDDLE)


@boundary("BD-CTL-003", "BD-CTL-005", "BD-CTL-008")
def negative_zero(d: Draft) -> None:
    d.set("controls", _of("intended", "throttle"), -0.0, rollout_id=BRAKE, tick=MIDDLE)
    d.set("controls", _of("applied", "steer"), -0.0, rollout_id=ACCELERATE, tick=MIDDLE)
    d.set("controls", _of("expert intended", "steer"), 0.0, rollout_id=BRAKE, tick=MIDDLE)
    d.set("controls", _of("applied", "steer"), -0.0, rollout_id=BRAKE, tick=MIDDLE)


@boundary("BD-CTL-007")
def expert_brakes_exactly_at_and_above_the_floor(d: Draft) -> None:
    d.set("controls", _of("expert intended applied", "brake"), 0.5, rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("controls", _of("expert intended applied", "brake"), 0.5000001, rollout_id=BRAKE, tick=MIDDLE)
    d.set("controls", "expert_brake", 0.4999999, rollout_id=BRAKE, tick=LAST)


@boundary("BD-CTL-003", "BD-CTL-004", "BD-CTL-005", "BD-CTL-006", "BD-CTL-007")
def bank_with_every_rule_on_every_actuator(d: Draft) -> None:
    rules = [ActuatorRule(rule=name) for name in ("online_expert", "stored_nominal", "zero")]
    rules += [ActuatorRule(rule="absolute", value=0.1), ActuatorRule(rule="floor", value=0.3)]
    policies = [
        Policy(
            key=f"p{k}", family="mixed", magnitude=0.5, duration_ticks=50, recovery="online_expert",
            steer=rules[k], throttle=rules[(k + 1) % 5], brake=rules[(k + 2) % 5],
        )
        for k in range(5)
    ]  # fmt: skip
    _drive_bank(d, ActionBank(name="mixed", policies=(load_action_bank().nominal, *policies)))


@boundary("BD-CTL-006", "BD-CTL-014")
def value_that_float32_rounds(d: Draft) -> None:
    d.descriptor["action_bank"]["policies"][8]["steer"]["value"] = -0.1 - 1e-10
    d.descriptor["action_encoding"] = None


# BD-CTL-008, BD-CTL-009


@mutant("BD-CTL-008", at=_place(STEER_LEFT, MIDDLE))
def applied_steering_negated(d: Draft) -> None:
    d.set("controls", "applied_steer", lambda steer: -steer, rollout_id=STEER_LEFT, tick=MIDDLE)


@mutant("BD-CTL-008", at=_place(BRAKE, LAST))
def command_not_applied_at_the_last_tick(d: Draft) -> None:
    expert = d.value("controls", "expert_brake", rollout_id=BRAKE, tick=LAST)
    d.set("controls", "applied_brake", expert, rollout_id=BRAKE, tick=LAST)


@mutant("BD-CTL-008", at=_place(STEER_LEFT, MIDDLE))
def applied_beyond_the_tolerance(d: Draft) -> None:
    d.descriptor["tolerances"] = {"actuator": 0.015625}
    d.set("controls", "applied_steer", lambda steer: steer + 0.0157, rollout_id=STEER_LEFT, tick=MIDDLE)


@mutant("BD-CTL-009", at=_place(BRAKE, BRANCH_TICK - 1))
def other_command_before_the_window(d: Draft) -> None:
    d.set("controls", "applied_throttle", 0.875, rollout_id=BRAKE, tick=BRANCH_TICK - 1)


@mutant("BD-CTL-009", at=_place(BRAKE, LAST + 1))
def brake_held_after_the_window(d: Draft) -> None:
    d.set("controls", "applied_brake", 0.875, rollout_id=BRAKE, tick=LAST + 1)


@mutant("BD-CTL-009", at=_place(NOMINAL, 50))
def nominal_that_was_steered(d: Draft) -> None:
    d.set("controls", "applied_steer", 0.5, rollout_id=NOMINAL, tick=50)


@mutant("BD-CTL-009", at=_place(REPLAY, MIDDLE), lost=0)
def replay_that_was_steered(d: Draft) -> None:
    d.set("controls", "applied_steer", 0.5, rollout_id=REPLAY, tick=MIDDLE)


@boundary("BD-CTL-008", "BD-CTL-009")
def applied_off_by_exactly_the_tolerance(d: Draft) -> None:
    d.descriptor["tolerances"] = {"actuator": 0.015625}
    d.set("controls", "applied_brake", 0.5 + 0.015625, rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("controls", ("expert_brake", "intended_brake"), 0.5, rollout_id=BRAKE, tick=BRANCH_TICK)
    d.set("controls", "expert_steer", -0.25, rollout_id=BRAKE, tick=50)
    d.set("controls", "applied_steer", -0.25 - 0.015625, rollout_id=BRAKE, tick=50)


@boundary("BD-CTL-010")
def stored_nominal_copies_what_was_applied(d: Draft) -> None:
    # Within the tolerance the nominal rollout's command was not met; copies follow the applied one.
    d.descriptor["tolerances"] = {"actuator": 0.015625}
    applied = d.value("controls", "applied_throttle", rollout_id=NOMINAL, tick=MIDDLE)
    d.set("controls", "expert_throttle", applied + 0.01, rollout_id=NOMINAL, tick=MIDDLE)


@mutant("BD-CTL-008", at={"rollout_id": FURTHER, "tick": BRANCH_TICK + 25}, findings=3, lost=2)
def commands_of_three_attempts_not_applied(d: Draft) -> None:
    for rollout_id in (*BOTH, STEER_LEFT):
        ticks = range(BRANCH_TICK + 25, BRANCH_TICK + 28)
        d.set("controls", "applied_brake", lambda brake: 0.9 - brake / 2, rollout_id=rollout_id, tick=ticks)


@mutant("BD-CTL-009", at={"rollout_id": FURTHER, "tick": 3}, findings=2, lost=2)
def experts_of_two_attempts_not_obeyed(d: Draft) -> None:
    d.set("controls", "applied_steer", 0.25, rollout_id=BOTH, tick=3)


# BD-CTL-010


@mutant("BD-CTL-010", at=_place(BRAKE, MIDDLE))
def stored_command_that_is_never_read(d: Draft) -> None:
    d.set("controls", "nominal_steer", 0.5, rollout_id=BRAKE, tick=MIDDLE)


@mutant("BD-CTL-010", at=_place(STEER_LEFT, MIDDLE))
def stored_throttle_of_the_expert(d: Draft) -> None:
    throttle = _other_throttle(d)
    d.set("controls", _of("nominal intended applied", "throttle"), throttle, rollout_id=STEER_LEFT, tick=MIDDLE)


@mutant("BD-CTL-010", at=_place("g0.brake_0.50.a1", 160))
def window_beyond_the_end_of_the_nominal(d: Draft) -> None:
    _drive_bank(d, _small_bank(duration_ticks=70))
    for table in TICK_TABLES:
        d.drop(table, rollout_id=NOMINAL, tick=range(160, 201))
    d.recount(NOMINAL)


# BD-CTL-011


@mutant("BD-CTL-011", at=_place(BRAKE, MIDDLE))
def expert_named_while_active(d: Draft) -> None:
    d.set("controls", "source", "online_expert", rollout_id=BRAKE, tick=MIDDLE)


@mutant("BD-CTL-011", at=_place(BRAKE, 50))
def intervention_named_while_inactive(d: Draft) -> None:
    d.set("controls", "source", "intervention", rollout_id=BRAKE, tick=50)


@mutant("BD-CTL-011", at=_place(REPLAY, 0), lost=0)
def intervention_named_in_a_replay(d: Draft) -> None:
    d.set("controls", "source", "intervention", rollout_id=REPLAY, tick=0)


@boundary("BD-CTL-011")
def source_changes_with_active(d: Draft) -> None:
    for tick, word in (
        (BRANCH_TICK - 1, "online_expert"),
        (BRANCH_TICK, "intervention"),
        (LAST, "intervention"),
        (LAST + 1, "online_expert"),
    ):
        assert d.value("controls", "source", rollout_id=BRAKE, tick=tick) == word


# BD-CTL-012


@mutant("BD-CTL-012", at=_place(BRAKE, 160))
def recording_ends_with_the_policy(d: Draft) -> None:
    _drive_bank(d, _small_bank(duration_ticks=60), num_ticks=160)


@mutant("BD-CTL-012", at={"rollout_id": BRAKE, "table": "controls"})
def recovery_that_cannot_be_recorded(d: Draft) -> None:
    _drive_bank(d, _small_bank(recovery="hold"))


# BD-CTL-013


@mutant("BD-CTL-013", at=_place(NOMINAL, 50))
def nominal_that_was_active(d: Draft) -> None:
    _activate(d, NOMINAL, [50])


@mutant("BD-CTL-013", at=_place(REPLAY, BRANCH_TICK), lost=0)
def replay_that_was_active_in_the_window(d: Draft) -> None:
    _activate(d, REPLAY, range(BRANCH_TICK, LAST + 1))
