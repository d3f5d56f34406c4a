"""Rules DOC and ENC: the descriptor and the encoding of its bank (spec/03-layout.md, spec/04-policies.md)."""

import hashlib
import json
import math
import re
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

import jsonschema
from contract import LIMITS, SCHEMAS, STREAMS, VERSION, document, names_place
from layout import DESCRIPTOR, LAYERS, Folder, Location
from referencing import Registry, Resource

FAMILIES = ("nominal", "accelerate", "brake", "steer_left", "steer_right")
SCALES = {"nominal": 1.0, "accelerate": 0.8, "brake": 1.0, "steer_left": 0.15, "steer_right": 0.15}
LONGITUDINAL = {
    "throttle": ("online_expert", "floor", "zero", "stored_nominal"),
    "brake": ("online_expert", "zero", "floor", "stored_nominal"),
}
#: What is read in place of a descriptor that is refused: nothing is known of its claims, so that all may be there.
EVERYTHING: dict[str, Any] = {"streams": list(STREAMS), "layers": list(LAYERS[:5])}
RECOVERIES = ("none", "online_expert", "stored_nominal", "hold")


def at(pointer: str) -> Location:
    """A place in the descriptor."""
    return {"file": DESCRIPTOR, "pointer": pointer}


def parse(data: bytes) -> Any:
    """The value of a document.

    Raises:
        ValueError: It is no JSON document within bounds.
    """
    if len(data) > LIMITS["max_document_bytes"] or data.startswith(b"\xef\xbb\xbf"):
        raise ValueError("too large, or a byte order mark")
    text = data.decode("utf-8")
    depth = 0
    for token in re.finditer(r'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]', text, re.DOTALL):
        depth += (token[0] in "[{") - (token[0] in "]}")
        if depth > LIMITS["max_document_depth"]:
            raise ValueError("nested too deeply")

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in items}) < len(items):
            raise ValueError("a key is repeated")
        return dict(items)

    def integer(digits: str) -> int:
        if len(digits) > 20:
            raise ValueError("an integer of too many characters")
        return int(digits)

    def number(digits: str) -> float:
        if math.isinf(float(digits)):
            raise ValueError("a number beyond the range of a double")
        return float(digits)

    def constant(name: str) -> Any:
        raise ValueError(name)

    return json.loads(text, object_pairs_hook=pairs, parse_int=integer, parse_float=number, parse_constant=constant)


@cache
def _validator() -> Any:
    """A validator of descriptors in which `$` matches at the end of the text only."""

    def pattern(_: Any, expression: str, instance: Any, __: Any) -> Iterator[jsonschema.ValidationError]:
        if isinstance(instance, str) and not re.search(re.sub(r"\$$", r"\\Z", expression), instance):
            yield jsonschema.ValidationError(f"{instance!r} does not match {expression!r}")

    resources = [Resource.from_contents(document(path.name)) for path in SCHEMAS.glob("*.schema.json")]
    registry = Registry().with_resources((str(resource.id()), resource) for resource in resources)
    kind = jsonschema.validators.extend(jsonschema.Draft202012Validator, {"pattern": pattern})
    return kind(document("descriptor.schema.json"), registry=registry)


def doc_001(folder: Folder) -> tuple[list[Location], Any]:
    """Documents are JSON within bounds; the second item is the descriptor, or None."""
    data = folder.read(DESCRIPTOR, LIMITS["max_document_bytes"])
    try:
        if data is not None:
            return [], parse(data)
    except (ValueError, RecursionError):
        pass
    return [{"file": DESCRIPTOR}], None


def doc_002(value: Any) -> list[Location]:
    """The validator supports the spec version; what is no object has none to support."""
    known = not isinstance(value, dict) or value.get("spec_version") == VERSION
    return [] if known else [at("/spec_version")]


def doc_003(value: Any) -> list[Location]:
    """Documents conform to their schema; a finding is a keyword that a place in the document violates."""
    violations = {(tuple(error.absolute_path), error.validator) for error in _validator().iter_errors(value)}
    return [at("/" + "/".join(map(str, path))) for path, _ in sorted(violations, key=str)]


def doc_004(descriptor: dict[str, Any]) -> list[Location]:
    """Descriptor agrees with itself."""
    found = []
    policies = descriptor["action_bank"]["policies"]
    nominal = [policy for policy in policies if policy["duration_ticks"] == 0]
    unique = len({policy["key"] for policy in policies}) == len(policies)
    idle = all(
        policy["magnitude"] == 0
        and policy["recovery"] == "none"
        and all(policy[actuator]["rule"] == "online_expert" for actuator in ("steer", "throttle", "brake"))
        for policy in nominal
    )
    recovered = all(policy["recovery"] != "none" for policy in policies if policy["duration_ticks"])
    if not (unique and len(nominal) == 1 and idle and recovered):
        found.append(at("/action_bank"))
    cameras = [camera["name"] for camera in descriptor.get("cameras", [])]
    if len(set(cameras)) < len(cameras):
        found.append(at("/"))
    computed = {"target_speed_mps", "vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard"}
    unrecorded = {name.removeprefix("observations.") for name in descriptor.get("unrecorded", [])}
    if (descriptor.get("driver") or {}).get("kind") == "log" and computed - unrecorded:
        found.append(at("/unrecorded"))
    return found


def doc_005(value: Any) -> list[Location]:
    """The descriptor names no path, host or clock time."""

    def texts(item: Any, pointer: str) -> Iterator[tuple[str, str]]:
        if isinstance(item, str):
            yield pointer, item
        elif isinstance(item, dict | list):
            pairs = item.items() if isinstance(item, dict) else enumerate(item)
            for key, child in pairs:
                yield from texts(child, f"{pointer}/{key}")

    return [at(pointer) for pointer, text in texts(value, "") if names_place(text)]


def encode(policy: dict[str, Any]) -> list[float] | None:
    """The vector `bd29` of a policy, or None outside of its domain."""
    family, magnitude = policy["family"], policy["magnitude"]
    steer, throttle, brake = policy["steer"], policy["throttle"], policy["brake"]
    value = steer.get("value") if steer["rule"] == "absolute" else 0.0
    steering = "left" if value < 0 else "right" if value > 0 else steer["rule"]
    kinds = ("online_expert", "zero", "left", "right")
    if family not in FAMILIES or steering not in kinds:
        return None
    if any(policy[actuator]["rule"] not in rules for actuator, rules in LONGITUDINAL.items()):
        return None
    signed = -magnitude if family == "steer_left" else 0.0 if family == "nominal" else magnitude
    return [
        *(float(family == name) for name in FAMILIES),
        signed,
        signed / SCALES[family],
        policy["duration_ticks"] * 0.05 / 2.5,
        value,
        *(rule["value"] if rule["rule"] == "floor" else 0.0 for rule in (throttle, brake)),
        *(float(steering == kind) for kind in kinds),
        *(float(policy[actuator]["rule"] == rule) for actuator, rules in LONGITUDINAL.items() for rule in rules),
        float("stored_nominal" in (throttle["rule"], brake["rule"])),
        float(steer["rule"] in ("zero", "absolute")),
        *(float(policy["recovery"] == recovery) for recovery in RECOVERIES),
    ]


def has_own_encoding(descriptor: dict[str, Any]) -> bool:
    """Whether an action encoding is declared that this version does not define."""
    encoding = descriptor.get("action_encoding")
    return encoding is not None and encoding["name"] != "bd29"


def enc_001(descriptor: dict[str, Any]) -> list[Location] | None:
    """Declared action encoding matches its recomputation from the bank; None where none is declared."""
    encoding = descriptor.get("action_encoding")
    if encoding is None:
        return None
    rows = [encode(policy) for policy in descriptor["action_bank"]["policies"]]
    if any(row is None for row in rows):
        return [at("/action_encoding")]
    matrix = b"".join(struct.pack("<29f", *row) for row in rows if row is not None)
    agrees = hashlib.sha256(matrix).hexdigest() == encoding["sha256"]
    return [] if agrees else [at("/action_encoding/sha256")]


def claimed_tables(descriptor: dict[str, Any]) -> list[str]:
    """Tables of the claimed streams."""
    return list(dict.fromkeys(table for name in descriptor["streams"] for table in STREAMS[name]["tables"]))


def claimed_cameras(descriptor: dict[str, Any]) -> list[str]:
    """Cameras of the claimed media streams, those beside the named ones too."""
    return [camera["name"] for camera in descriptor.get("cameras", []) if camera["stream"] in descriptor["streams"]]
