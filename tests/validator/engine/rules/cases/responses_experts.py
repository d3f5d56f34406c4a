"""Defects and limits of the expert that an intervention overrides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft

Row = dict[str, object]


# BD-RSP-010


def _override(d: Draft, expert: Callable[[Row, Row], Row]) -> None:
    """Let the expert command something else while it is overridden, and let policies follow it.

    `expert` gives its commands by a row and by the first active row of the same attempt.
    """
    policies = {policy["key"]: policy for policy in d.descriptor["action_bank"]["policies"]}
    for shard in d.tables.values():
        keys = {row["rollout_id"]: row["action_key"] for row in shard["rollouts"].to_pylist()}
        rows, first = shard["controls"].to_pylist(), dict[str, Row]()
        for row in rows:
            if row["active"]:
                command = expert(row, first.setdefault(row["rollout_id"], dict(row)))
                for actuator, value in command.items():
                    rule = policies[keys[row["rollout_id"]]][actuator]
                    row[f"expert_{actuator}"] = value
                    if rule["rule"] in ("online_expert", "floor"):
                        demanded = max(value, np.float32(rule.get("value") or -1))
                        row[f"intended_{actuator}"] = row[f"applied_{actuator}"] = float(demanded)
        shard["controls"] = pa.Table.from_pylist(rows, shard["controls"].schema)


def _commands(row: Row, kind: str) -> Row:
    return {actuator: row[f"{kind}_{actuator}"] for actuator in ("steer", "throttle", "brake")}


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_steer"}, findings=2)
def expert_that_stops_while_it_is_overridden(d: Draft) -> None:
    _override(d, lambda _, first: _commands(first, "expert"))


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_throttle"}, findings=2)
def expert_of_the_nominal(d: Draft) -> None:
    _override(d, lambda row, _: _commands(row, "nominal"))


@mutant("BD-RSP-010", base="bare", at={"table": "controls", "column": "expert_steer"}, findings=2)
def expert_that_is_what_was_applied(d: Draft) -> None:
    _override(d, lambda row, _: _commands(row, "applied"))


@boundary("BD-RSP-010", base="bare")
def expert_that_decides_once_a_second(d: Draft) -> None:
    """And holds its command between."""
    held: dict[tuple[str, int], Row] = {}
    _override(
        d,
        lambda row, _: held.setdefault((str(row["rollout_id"]), int(str(row["tick"])) // 20), _commands(row, "expert")),
    )


@boundary("BD-RSP-010", base="bare", status="skipped")
def log_that_goes_on(d: Draft) -> None:
    """A log commands what the nominal did, wherever the vehicle is."""
    d.descriptor["driver"] = {"kind": "log"}
    d.descriptor["unrecorded"] = [
        f"observations.{name}"
        for name in ("target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard")
    ]
    d.set("observations", tuple(name.partition(".")[2] for name in d.descriptor["unrecorded"]), None)
    _override(d, lambda row, _: _commands(row, "nominal"))
