"""Defects and limits of what policies of a rollout are recorded to be."""

from __future__ import annotations

from tests.validator.engine.rules.case import (
    ACCELERATE,
    BRAKE,
    NOMINAL,
    STEER_LEFT,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

# BD-CTL-014


def _effective(rollout_id: str, column: str) -> dict[str, str]:
    return {"table": "rollouts", "rollout_id": rollout_id, "column": column}


@mutant("BD-CTL-014", at=_effective(ACCELERATE, "effective_steer_rule"))
def accelerates_with_online_steering(d: Draft) -> None:
    d.set("rollouts", "effective_steer_rule", "online_expert", rollout_id=ACCELERATE)


@mutant("BD-CTL-014", at=_effective(STEER_LEFT, "effective_steer_value"))
def steers_to_the_other_side(d: Draft) -> None:
    d.set("rollouts", "effective_steer_value", 0.1, rollout_id=STEER_LEFT)


@mutant("BD-CTL-014", at=_effective(BRAKE, "effective_duration_ticks"))
def meant_to_last_longer(d: Draft) -> None:
    d.set("rollouts", "effective_duration_ticks", 51, rollout_id=BRAKE)


@mutant("BD-CTL-014", at=_effective(BRAKE, "effective_recovery"))
def recovered_otherwise(d: Draft) -> None:
    d.set("rollouts", "effective_recovery", "stored_nominal", rollout_id=BRAKE)


@mutant("BD-CTL-014", at=_effective(NOMINAL, "effective_brake_rule"))
def nominal_that_coasts(d: Draft) -> None:
    d.set("rollouts", "effective_brake_rule", "zero", rollout_id=NOMINAL)
