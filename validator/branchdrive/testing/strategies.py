"""Hypothesis strategies for everything that the contract declares.

Ranges, patterns and vocabularies are read from the files of `schemas/`, never retyped: a strategy
of *documents* draws JSON values that conform, a strategy of models draws the typed view of one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from hypothesis import strategies as st

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.columns import DECISIONS, PATTERNS, RECORDABLE, STREAMS, TABLES, Column
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH
from branchdrive.contract.policy import ACTUATORS, ActuatorRule, Command, Policy
from branchdrive.contract.resources import load_resource
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.testing.cameras import camera_lists
from branchdrive.testing.conforming import conforming, matching

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hypothesis.strategies import DrawFn, SearchStrategy
    from numpy.typing import NDArray

Document = dict[str, Any]

VALUED_RULES = ("absolute", "floor")
"""Actuator rules that carry a value."""

BD29_RULES: Mapping[str, Sequence[str]] = {
    "steer": ("online_expert", "zero", "absolute"),
    "throttle": ("online_expert", "floor", "zero", "stored_nominal"),
    "brake": ("online_expert", "zero", "floor", "stored_nominal"),
}
"""Rules inside the domain of `bd29`, by actuator; an absolute steering command of 0 is outside."""

BD29_FAMILIES = ("nominal", "accelerate", "brake", "steer_left", "steer_right")
"""Families inside the domain of `bd29`."""

_UNICODE = st.characters(codec="utf-8")
_INT_RANGES = {"int32": (-(2**31), 2**31 - 1), "int64": (-(2**63), 2**63 - 1)}
_MAX_EXTENT_M = 100.0


# --- text and numbers


@cache
def named_text(pattern_name: str) -> SearchStrategy[str]:
    """Text of a pattern that `columns.json` names."""
    return matching(PATTERNS[pattern_name])


def identifiers() -> SearchStrategy[str]:
    """Identifiers: keys, rollout ids, group ids, camera names."""
    return named_text("id")


def _float32_floats(low: float | None, high: float | None) -> SearchStrategy[float]:
    """Finite float32 numbers of a closed range, its float32 bounds included."""

    def inward(bound: float | None, direction: float) -> float | None:
        if bound is None:
            return None
        nearest = np.float32(bound)
        outside = (float(nearest) - bound) * direction < 0
        return float(np.nextafter(nearest, np.float32(direction * np.inf))) if outside else float(nearest)

    return st.floats(inward(low, 1), inward(high, -1), width=32, allow_nan=False, allow_infinity=False)


def _floats(low: float | None, high: float | None) -> SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


@cache
def column_values(column: Column) -> SearchStrategy[Any]:
    """Values that a column may hold where it is not null."""
    if column.values:
        return st.sampled_from(column.values)
    if column.pattern:
        return named_text(column.pattern)
    if column.unit == "m" and column.min is None:  # an extent of a box
        return _float32_floats(0.0078125, _MAX_EXTENT_M)
    match column.type:
        case "bool":
            return st.booleans()
        case "int32" | "int64":
            low, high = _INT_RANGES[column.type]
            return st.integers(
                low if column.min is None else int(column.min),
                high if column.max is None else int(column.max),
            )
        case "float32":
            return _float32_floats(column.min, column.max)
        case "float64":
            return _floats(column.min, column.max)
        case "list<float64>":
            return st.lists(_floats(column.min, column.max), min_size=2, max_size=8)
    return st.text(_UNICODE)


# --- documents, from their schemas


@cache
def actuator_rule_documents() -> SearchStrategy[Document]:
    """Actuator rules; the value may be null where there is none."""
    declared = load_resource("policy.schema.json")["$defs"]["actuator_rule"]["properties"]
    values = conforming(declared["value"]["anyOf"][0])
    plain = st.sampled_from([rule for rule in declared["rule"]["enum"] if rule not in VALUED_RULES])
    valued = st.fixed_dictionaries({"rule": st.sampled_from(VALUED_RULES), "value": values})
    return valued | st.fixed_dictionaries({"rule": plain}, optional={"value": st.none()})


@cache
def policy_documents() -> SearchStrategy[Document]:
    """Policies in the algebra, whether or not a bank could hold them."""
    rules = actuator_rule_documents()
    return conforming("policy.schema.json", **dict.fromkeys(ACTUATORS, rules))


def _intervening(policy: Document) -> Document:
    recovery = "online_expert" if policy["recovery"] == "none" else policy["recovery"]
    return {**policy, "duration_ticks": max(1, policy["duration_ticks"]), "recovery": recovery}


def _leaving_alone(policy: Document) -> Document:
    rules = {actuator: {"rule": "online_expert"} for actuator in ACTUATORS}
    return {**policy, "magnitude": 0, "duration_ticks": 0, "recovery": "none", **rules}


@cache
def _bd29_rule_documents(actuator: str) -> SearchStrategy[Document]:
    """Rules of one actuator inside the domain of `bd29`."""
    known = BD29_RULES[actuator]
    return actuator_rule_documents().filter(
        lambda rule: rule["rule"] in known and (rule["rule"] != "absolute" or rule["value"] != 0)
    )


@cache
def bd29_policy_documents() -> SearchStrategy[Document]:
    """Policies inside the domain of `bd29`."""
    rules = {actuator: _bd29_rule_documents(actuator) for actuator in ACTUATORS}
    return conforming("policy.schema.json", family=st.sampled_from(BD29_FAMILIES), **rules)


@st.composite
def bank_documents(
    draw: DrawFn,
    policies: SearchStrategy[Document] | None = None,
    *,
    max_policies: int = 6,
    nominal_family: str | None = None,
) -> Document:
    """Banks that keep their conditions; the nominal policy stands anywhere."""
    policies = policy_documents() if policies is None else policies
    drawn = draw(st.lists(policies, min_size=2, max_size=max_policies, unique_by=itemgetter("key")))
    nominal_index = draw(st.integers(0, len(drawn) - 1))
    bank = [_intervening(policy) for policy in drawn]
    bank[nominal_index] = _leaving_alone(drawn[nominal_index])
    if nominal_family is not None:
        bank[nominal_index]["family"] = nominal_family
    return {"name": draw(identifiers()), "policies": bank}


@cache
def encoding_documents() -> SearchStrategy[Document]:
    """Declared action encodings; `bd29` with its width, and others."""
    anything = conforming("action-encoding.schema.json")
    others = anything.filter(lambda encoding: encoding["name"] != ENCODING_NAME)
    return others | others.map(lambda encoding: {**encoding, "name": ENCODING_NAME, "width": ENCODING_WIDTH})


@cache
def _collection_documents() -> SearchStrategy[Document]:
    """What a collector switched on; scenario types do not repeat."""
    declared = load_resource("descriptor.schema.json")["properties"]["collection"]
    return conforming(declared, scenario_types=st.lists(named_text("label"), unique=True, max_size=4))


@cache
def _unclaiming_descriptor_documents() -> SearchStrategy[Document]:
    """Descriptors that claim no stream and have no camera yet."""
    return conforming(
        "descriptor.schema.json",
        streams=st.just([]),
        unrecorded=st.lists(st.sampled_from(RECORDABLE), unique=True),
        cameras=st.just([]),
        action_bank=bank_documents(max_policies=3),
        action_encoding=st.none() | encoding_documents(),
        collection=_collection_documents(),
    )


@st.composite
def descriptor_documents(draw: DrawFn) -> Document:
    """Descriptors of small banks and of branch groups, optional properties there or not."""
    document = draw(_unclaiming_descriptor_documents())
    if (document.get("driver") or {}).get("kind") == "log":
        document["unrecorded"] = list(RECORDABLE)
    required = [name for name, stream in STREAMS.items() if stream.required]
    optional = [name for name in STREAMS if name not in (*required, DECISIONS)]
    document["streams"] = draw(st.permutations([*required, *sorted(draw(st.sets(st.sampled_from(optional))))]))
    if cameras := draw(camera_lists(document["streams"])):
        document["cameras"] = cameras
    return document


@st.composite
def masked_values(draw: DrawFn) -> Document:
    """Values with their masks, as documents: null exactly where the mask is 0."""
    value = draw(st.none() | _floats(None, None))
    return {"value": value, "mask": int(value is not None)}


# --- models


@cache
def actuator_rules() -> SearchStrategy[ActuatorRule]:
    """Actuator rules."""
    return actuator_rule_documents().map(ActuatorRule.model_validate)


@cache
def policies() -> SearchStrategy[Policy]:
    """Policies in the algebra, inside and outside the domain of `bd29`."""
    return policy_documents().map(Policy.model_validate)


@cache
def bd29_policies() -> SearchStrategy[Policy]:
    """Policies inside the domain of `bd29`."""
    return bd29_policy_documents().map(Policy.model_validate)


@st.composite
def policies_outside_bd29(draw: DrawFn) -> Policy:
    """Policies that lie outside the domain of `bd29` for one reason."""
    policy = draw(bd29_policy_documents())
    what = draw(st.sampled_from(("family", *ACTUATORS)))
    if what == "family":
        families = matching(load_resource("policy.schema.json")["properties"]["family"]["pattern"])
        policy["family"] = draw(families.filter(lambda family: family not in BD29_FAMILIES))
    else:
        outside = actuator_rule_documents().filter(lambda rule: rule["rule"] not in BD29_RULES[what])
        straight: Document = {"rule": "absolute", "value": 0.0}
        policy[what] = draw(outside | st.just(straight) if what == "steer" else outside)
    return Policy.model_validate(policy)


@cache
def banks() -> SearchStrategy[ActionBank]:
    """Action banks in the algebra."""
    return bank_documents().map(ActionBank.model_validate)


@cache
def bd29_banks() -> SearchStrategy[ActionBank]:
    """Action banks inside the domain of `bd29`."""
    documents = bank_documents(bd29_policy_documents(), nominal_family="nominal")
    return documents.map(ActionBank.model_validate)


@cache
def descriptors() -> SearchStrategy[Descriptor]:
    """Descriptors of small banks."""
    return descriptor_documents().map(Descriptor.model_validate)


# --- rows and columns


def masks(num_rows: int) -> SearchStrategy[NDArray[np.bool_]]:
    """Availability masks, bool ``[num_rows]``."""
    bits = st.lists(st.booleans(), min_size=num_rows, max_size=num_rows)
    return bits.map(lambda drawn: np.array(drawn, np.bool_))


@st.composite
def commands(draw: DrawFn, num_ticks: int) -> Command:
    """Recorded commands of the online expert, float32 ``[num_ticks]`` each."""

    def signal(actuator: str) -> NDArray[np.float32]:
        values = column_values(TABLES["controls"][f"expert_{actuator}"])
        return np.resize(np.array(draw(st.lists(values, min_size=1, max_size=7)), np.float32), num_ticks)

    return Command(signal("steer"), signal("throttle"), signal("brake"))


@dataclass(frozen=True)
class ControlLog:
    """Control rows of one rollout that executes `policy` as its rules demand.

    Attributes:
        policy: The executed policy.
        branch_tick: First tick at which an intervention is active.
        columns: Columns of the controls table, ``[num_ticks]`` each; nullable ones are masked arrays.
    """

    policy: Policy
    branch_tick: int
    columns: Mapping[str, Any]

    @property
    def num_ticks(self) -> int:
        """Control rows."""
        return len(self.columns["tick"])


@st.composite
def control_logs(draw: DrawFn, policy: SearchStrategy[Policy] | None = None) -> ControlLog:
    """Control logs; intended and applied commands follow from the expert's by the algebra.

    `policy` defaults to the policies of the reference bank, whose commands stay inside the ranges of
    the columns; a policy of the algebra at large need not.
    """
    policy = st.sampled_from(load_action_bank().policies) if policy is None else policy
    chosen = draw(policy)
    branch_tick = CONTROL_HISTORY_TICKS + OBSERVATION_STRIDE_TICKS * draw(st.integers(0, 3))
    num_ticks = branch_tick + chosen.duration_ticks + draw(st.integers(1, 6))
    tick = np.arange(num_ticks, dtype=np.int32)
    active = (tick >= branch_tick) & (tick < branch_tick + chosen.duration_ticks)
    expert, nominal = draw(commands(num_ticks)), draw(commands(num_ticks))
    intended = chosen.command(expert, nominal)
    columns: dict[str, Any] = {
        "rollout_id": np.repeat(draw(identifiers()), num_ticks),
        "tick": tick,
        "active": active,
        "source": np.where(active, "intervention", "online_expert"),
    }
    for actuator in ACTUATORS:
        own, stored, demanded = (getattr(command, actuator) for command in (expert, nominal, intended))
        columns[f"expert_{actuator}"] = own
        columns[f"nominal_{actuator}"] = np.ma.masked_array(stored, ~active)
        columns[f"intended_{actuator}"] = np.ma.masked_array(demanded, ~active)
        columns[f"applied_{actuator}"] = np.where(active, demanded, own)
    declared = {column.name: columns[column.name] for column in TABLES["controls"].columns}
    return ControlLog(chosen, branch_tick, declared)


@st.composite
def rollout_records(draw: DrawFn, bank: SearchStrategy[ActionBank] | None = None) -> Document:
    """Rows of the rollouts table that agree with themselves and with a policy of a bank."""
    table = TABLES["rollouts"]
    known = load_action_bank() if bank is None else draw(bank)
    role = draw(column_values(table["role"]).filter(lambda role: role != "drive"))
    policy = draw(st.sampled_from(known.interventions)) if role == "intervention" else known.nominal
    has_branch = draw(st.booleans())
    status = draw(column_values(table["status"]))
    holds = {"branched": has_branch, "not_complete": status != "complete", "not_nominal": role != "nominal"}
    record: Document = {}
    for column in table.columns:
        when = column.available.when if column.available else None
        is_present = draw(st.booleans()) if when == "optional" else holds.get(str(when), True)
        record[column.name] = draw(column_values(column)) if is_present else None
    num_ticks = draw(st.integers(CONTROL_HISTORY_TICKS + 51, 400))
    record |= {
        "role": role,
        "status": status,
        "action_key": policy.key,
        **policy.effective_action(),
        "route_y_m": [*record["route_x_m"][1:], record["route_x_m"][0]],
        "num_ticks": num_ticks,
        "num_observations": -(-num_ticks // OBSERVATION_STRIDE_TICKS),
    }
    if has_branch:
        last = (num_ticks - 51) // OBSERVATION_STRIDE_TICKS
        frame = draw(st.integers(CONTROL_HISTORY_TICKS // OBSERVATION_STRIDE_TICKS, last))
        trigger_rollout_id = record["rollout_id"] if role == "nominal" else record["nominal_rollout_id"]
        record |= {
            "branch_tick": frame * OBSERVATION_STRIDE_TICKS,
            "branch_frame": frame,
            "trigger_rollout_id": trigger_rollout_id,
        }
    return record
