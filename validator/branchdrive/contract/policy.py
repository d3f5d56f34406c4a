"""The actuator algebra: what an intervention policy does to steering, throttle and brake.

A policy gives each actuator one rule. With the online expert's command ``u^E_t`` on the state of
this rollout and the stored nominal command ``u^{E,0}_t``, the command at an active tick is

========================  =========================
``online_expert``         ``u_t = u^E_t``
``stored_nominal``        ``u_t = u^{E,0}_t``
``zero``                  ``u_t = 0``
``absolute(v)``           ``u_t = v``
``floor(v)``              ``u_t = max(u^E_t, v)``
========================  =========================

Everything is float32, the type in which commands are recorded, so that intended and applied
controls compare exactly. Collectors drive with these functions and the validator recomputes them.

Source: paper, "Intervention Policy Bank", Table 2; spec/04-policies.md.
"""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.contract.document import Integer

__all__ = ["ACTUATORS", "ActuatorRule", "Command", "Policy", "Signal"]

ACTUATORS = ("steer", "throttle", "brake")
"""The actuators of a command, in recorded order."""

Signal: TypeAlias = NDArray[np.float32]
"""One actuator's commands, float32: a scalar array for one tick or ``[ticks]``."""


class Command(NamedTuple):
    """Commands of the three actuators; steering is positive to the right."""

    steer: Signal
    throttle: Signal
    brake: Signal


class ActuatorRule(BaseModel):
    """Rule of one actuator; ``value`` is there exactly for ``absolute`` and ``floor``."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    rule: Literal["online_expert", "stored_nominal", "zero", "absolute", "floor"]
    value: Annotated[float, Field(ge=-1, le=1)] | None = None

    @model_validator(mode="after")
    def _value_belongs_to_rule(self) -> Self:
        if (self.value is not None) != (self.rule in ("absolute", "floor")):
            raise ValueError(
                f"`value` belongs to `absolute` and `floor` rules only, and must be there; rule is {self.rule!r}"
            )
        return self

    def evaluate(self, expert: Signal, nominal: Signal | None) -> Signal:
        """Command that the rule demands.

        Args:
            expert: Online-expert command ``u^E``, float32, any shape.
            nominal: Stored nominal command ``u^{E,0}`` of the same shape; needed by `stored_nominal`.

        Raises:
            ValueError: The rule copies the nominal command and there is none.
        """
        expert = np.asarray(expert, np.float32)
        match self.rule:
            case "online_expert":
                return expert
            case "stored_nominal":
                if nominal is None:
                    raise ValueError("`stored_nominal` needs the nominal command of this tick")
                return np.asarray(nominal, np.float32)
            case "zero":
                return np.zeros_like(expert)
            case "absolute":
                return np.full_like(expert, self.value)
            case "floor":
                return np.asarray(np.maximum(expert, np.float32(self.value)), np.float32)


class Policy(BaseModel):
    """One candidate policy of an action bank.

    Attributes:
        key: Canonical action key, the policy's identity.
        family: Family name, for example ``accelerate``.
        magnitude: Unsigned size of the manoeuvre; 0 for the nominal policy.
        duration_ticks: Ticks for which the policy drives; 0 for the nominal policy.
        recovery: Controller after the active window; ``none`` for the nominal policy.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    key: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,127}$")]
    family: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
    magnitude: Annotated[float, Field(ge=0, le=1)]
    duration_ticks: Annotated[Integer, Field(ge=0, le=1000)]
    recovery: Literal["none", "online_expert", "stored_nominal", "hold"]
    steer: ActuatorRule
    throttle: ActuatorRule
    brake: ActuatorRule

    @property
    def rules(self) -> tuple[ActuatorRule, ActuatorRule, ActuatorRule]:
        """Rules in the order of `ACTUATORS`."""
        return (self.steer, self.throttle, self.brake)

    @property
    def is_nominal(self) -> bool:
        """Whether the online expert keeps all actuators, so that nothing is ever active."""
        return self.duration_ticks == 0

    def command(self, expert: Command, nominal: Command | None = None) -> Command:
        """Intended command at active ticks, from the expert's and the stored nominal command."""
        stored = nominal or (None, None, None)
        steer, throttle, brake = (
            rule.evaluate(own, copied) for rule, own, copied in zip(self.rules, expert, stored, strict=True)
        )
        return Command(steer, throttle, brake)

    def effective_action(self) -> dict[str, str | float | int | None]:
        """The ``effective_*`` columns of a rollout that executes this policy."""
        columns: dict[str, str | float | int | None] = {}
        for actuator, rule in zip(ACTUATORS, self.rules, strict=True):
            columns[f"effective_{actuator}_rule"] = rule.rule
            columns[f"effective_{actuator}_value"] = None if rule.value is None else float(np.float32(rule.value))
        columns["effective_duration_ticks"] = self.duration_ticks
        columns["effective_recovery"] = self.recovery
        return columns
