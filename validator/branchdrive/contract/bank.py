"""Action banks: the candidate policies of a dataset, as data.

Source: paper, "Intervention Policy Bank"; spec/04-policies.md; the reference bank is `schemas/v0.1/action-bank.json`.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.contract.policy import Policy
from branchdrive.contract.resources import load_resource

__all__ = ["ActionBank", "load_action_bank"]


class ActionBank(BaseModel):
    """Policies in presentation order; order presents, the key identifies.

    Raises:
        pydantic.ValidationError: Keys repeat, or there is not exactly one nominal policy.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,127}$")]
    policies: Annotated[tuple[Policy, ...], Field(min_length=2, max_length=256, strict=False, fail_fast=True)]

    @model_validator(mode="after")
    def _keys_identify(self) -> Self:
        keys = [policy.key for policy in self.policies]
        repeated = sorted({key for key in keys if keys.count(key) > 1})
        if repeated:
            raise ValueError(f"action keys must be unique; repeated: {repeated}")
        nominals = [policy for policy in self.policies if policy.is_nominal]
        if len(nominals) != 1:
            raise ValueError(f"a bank has exactly one nominal policy; found {[policy.key for policy in nominals]}")
        for policy in self.policies:
            expert_only = all(rule.rule == "online_expert" for rule in policy.rules)
            if policy.is_nominal and not (expert_only and policy.recovery == "none" and policy.magnitude == 0):
                raise ValueError(f"policy {policy.key!r} of duration 0 must leave every actuator to the online expert")
            if not policy.is_nominal and policy.recovery == "none":
                raise ValueError(f"policy {policy.key!r} intervenes and must name its recovery controller")
        return self

    def __getitem__(self, key: str) -> Policy:
        """The policy of a canonical action key; raises `KeyError` if the bank lacks it."""
        for policy in self.policies:
            if policy.key == key:
                return policy
        raise KeyError(key)

    @property
    def keys(self) -> tuple[str, ...]:
        """Canonical action keys in presentation order."""
        return tuple(policy.key for policy in self.policies)

    @property
    def nominal(self) -> Policy:
        """The policy that leaves the ego to the online expert."""
        return next(policy for policy in self.policies if policy.is_nominal)

    @property
    def nominal_index(self) -> int:
        """Place of the nominal policy in presentation order."""
        return self.policies.index(self.nominal)

    @property
    def interventions(self) -> tuple[Policy, ...]:
        """Every policy but the nominal one, in presentation order."""
        return tuple(policy for policy in self.policies if not policy.is_nominal)


@cache
def load_action_bank() -> ActionBank:
    """The 13-policy bank of the paper."""
    return ActionBank.model_validate(load_resource("action-bank.json"))
