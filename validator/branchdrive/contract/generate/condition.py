"""Conditions of availability in words. Source: spec/06-masks.md#conditions."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["CONDITIONS"]

CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        "branched": "exactly where the row has a `branch_tick`",
        "not_complete": "exactly where `status` is not `complete`",
        "not_nominal": "exactly where `role` is not `nominal`",
        "valued": "exactly where the rule column of the same actuator is `absolute` or `floor`",
        "active": "exactly where `active` is true",
        "optional": "wherever the collector could know it",
    }
)
"""When a value of a conditional column is present, by the name of the condition."""
