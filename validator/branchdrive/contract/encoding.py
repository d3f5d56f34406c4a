"""The 29-D action encoding `bd29`: semantics of a policy as a vector, a pure function of its record.

Layout, in order: family one-hot (5), signed magnitude, scaled signed magnitude, forced duration,
lateral command, throttle floor, brake floor, steering-rule one-hot (4), throttle-rule one-hot (4),
brake-rule one-hot (4), longitudinal open loop, lateral override, recovery one-hot (4).
Computed in float64 and rounded once to float32. Source: paper, "Model Inputs and Targets"; spec/04-policies.md.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.policy import ActuatorRule, Policy
from branchdrive.contract.timing import TICK_S
from branchdrive.errors import UsageError

__all__ = ["ENCODING_NAME", "ENCODING_WIDTH", "encode_bank", "encode_policy", "encoding_digest"]

ENCODING_NAME = "bd29"
ENCODING_WIDTH = 29

FULL_DURATION_S = 2.5
"""Scale of the forced duration, seconds."""

_FAMILY_SIGN = {"nominal": 0.0, "accelerate": 1.0, "brake": 1.0, "steer_left": -1.0, "steer_right": 1.0}
_FAMILY_SCALE = {"nominal": 1.0, "accelerate": 0.80, "brake": 1.00, "steer_left": 0.15, "steer_right": 0.15}
_STEER_RULES = ("online_expert", "zero", "absolute_left", "absolute_right")
_THROTTLE_RULES = ("online_expert", "floor", "zero", "stored_nominal")
_BRAKE_RULES = ("online_expert", "zero", "floor", "stored_nominal")
_RECOVERIES = ("none", "online_expert", "stored_nominal", "hold")


def _one_hot(value: str, choices: tuple[str, ...], policy: Policy, what: str) -> list[float]:
    if value not in choices:
        raise UsageError(
            f"policy {policy.key!r}: {what} {value!r} is outside the domain of `{ENCODING_NAME}`, which knows {choices}"
        )
    return [float(value == choice) for choice in choices]


def _steer_rule(rule: ActuatorRule) -> str:
    if rule.rule == "absolute" and rule.value:
        return "absolute_left" if rule.value < 0 else "absolute_right"
    return rule.rule


def _floor(rule: ActuatorRule) -> float:
    return float(rule.value or 0.0) if rule.rule == "floor" else 0.0


def encode_policy(policy: Policy) -> NDArray[np.float32]:
    """`bd29` vector of one policy, float32 ``[29]``.

    Raises:
        UsageError: The policy lies outside the encoding's domain of families and rules.
    """
    family = _one_hot(policy.family, tuple(_FAMILY_SIGN), policy, "family")
    signed = _FAMILY_SIGN[policy.family] * policy.magnitude
    lateral = float(policy.steer.value or 0.0) if policy.steer.rule == "absolute" else 0.0
    vector = [
        *family,
        signed,
        signed / _FAMILY_SCALE[policy.family],
        policy.duration_ticks * TICK_S / FULL_DURATION_S,
        lateral,
        _floor(policy.throttle),
        _floor(policy.brake),
        *_one_hot(_steer_rule(policy.steer), _STEER_RULES, policy, "steering rule"),
        *_one_hot(policy.throttle.rule, _THROTTLE_RULES, policy, "throttle rule"),
        *_one_hot(policy.brake.rule, _BRAKE_RULES, policy, "brake rule"),
        float("stored_nominal" in (policy.throttle.rule, policy.brake.rule)),
        float(policy.steer.rule in ("zero", "absolute")),
        *_one_hot(policy.recovery, _RECOVERIES, policy, "recovery"),
    ]
    # Adding 0 turns -0.0 into 0.0: one zero, one digest.
    return (np.asarray(vector, np.float64) + 0.0).astype(np.float32)


def encode_bank(bank: ActionBank) -> NDArray[np.float32]:
    """`bd29` matrix of a bank, float32 ``[policies, 29]``, rows in presentation order."""
    return np.stack([encode_policy(policy) for policy in bank.policies])


def encoding_digest(bank: ActionBank) -> str:
    """SHA-256 of the bank's matrix, row-major little-endian float32."""
    return hashlib.sha256(encode_bank(bank).astype("<f4").tobytes()).hexdigest()
