"""Defects and limits of the descriptor and of the action encoding that it declares."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.encoding import encoding_digest
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.contract.limits import spec_limits

PLACE = {"file": DESCRIPTOR_FILE}


ENCODING = {**PLACE, "pointer": "/action_encoding/sha256"}


def _rewrite(d: Draft, change: Any) -> None:
    def edit(root: Path) -> None:
        path = root / DESCRIPTOR_FILE
        path.write_bytes(change(path.read_bytes()))

    d.before_seal(edit)


# BD-DOC-001


@mutant("BD-DOC-001", at=PLACE)
def not_json(d: Draft) -> None:
    _rewrite(d, lambda content: content[:-3])


@mutant("BD-DOC-001", at=PLACE)
def nan(d: Draft) -> None:
    _rewrite(d, lambda content: content.replace(b'"magnitude": 0.3', b'"magnitude": NaN', 1))


@mutant("BD-DOC-001", at=PLACE)
def number_beyond_a_double(d: Draft) -> None:
    _rewrite(d, lambda content: content.replace(b'"magnitude": 0.3', b'"magnitude": 1e999', 1))


@mutant("BD-DOC-001", at=PLACE)
def repeated_key(d: Draft) -> None:
    _rewrite(d, lambda content: content.replace(b'"title":', b'"title": "other", "title":', 1))


@mutant("BD-DOC-001", at=PLACE)
def byte_order_mark(d: Draft) -> None:
    _rewrite(d, lambda content: b"\xef\xbb\xbf" + content)


@mutant("BD-DOC-001", at=PLACE)
def not_utf8(d: Draft) -> None:
    _rewrite(d, lambda content: content.replace(b"A small", b"A \xff small", 1))


@mutant("BD-DOC-001", at=PLACE)
def nested_too_deep(d: Draft) -> None:
    levels = spec_limits().max_document_depth
    _rewrite(d, lambda content: content.replace(b'"none"', b"[" * levels + b"]" * levels, 1))


@mutant("BD-DOC-001", at=PLACE)
def too_large(d: Draft) -> None:
    _rewrite(d, lambda content: content.ljust(spec_limits().max_document_bytes + 1))


@mutant("BD-DOC-001", at=PLACE)
def missing(d: Draft) -> None:
    d.before_seal(lambda root: (root / DESCRIPTOR_FILE).unlink())


@boundary("BD-DOC-001")
def document_as_large_as_allowed(d: Draft) -> None:
    _rewrite(d, lambda content: content.ljust(spec_limits().max_document_bytes))


# BD-DOC-002


@mutant("BD-DOC-002", at={**PLACE, "pointer": "/spec_version"})
def version_of_the_future(d: Draft) -> None:
    d.descriptor["spec_version"] = "0.2"


@mutant("BD-DOC-002", at={**PLACE, "pointer": "/spec_version"})
def version_missing(d: Draft) -> None:
    del d.descriptor["spec_version"]


@mutant("BD-DOC-002", at={**PLACE, "pointer": "/spec_version"})
def version_is_a_number(d: Draft) -> None:
    d.descriptor["spec_version"] = 0.1


@boundary("BD-DOC-002")
def descriptor_in_another_order_and_form(d: Draft) -> None:
    reverse = dict(reversed(d.descriptor.items()))
    _rewrite(d, lambda _: json.dumps(reverse, separators=(",", ":")).encode())


# BD-DOC-003


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/"})
def title_missing(d: Draft) -> None:
    del d.descriptor["title"]


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/"})
def unknown_property(d: Draft) -> None:
    d.descriptor["host"] = "rack-7"


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/rates/observation_stride_ticks"})
def another_rate(d: Draft) -> None:
    d.descriptor["rates"] = {"observation_stride_ticks": 10}


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/streams"})
def required_stream_not_claimed(d: Draft) -> None:
    d.descriptor["streams"].remove("route_result")


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/dataset_version"})
def version_with_a_final_newline(d: Draft) -> None:
    d.descriptor["dataset_version"] = "0.1.0\n"


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/action_bank/policies/1/throttle"})
def floor_without_a_value(d: Draft) -> None:
    del d.descriptor["action_bank"]["policies"][1]["throttle"]["value"]


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/action_encoding"})
def encoding_of_another_width(d: Draft) -> None:
    d.descriptor["action_encoding"]["width"] = 30


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/"}, findings=2)
def list_of_descriptors(d: Draft) -> None:
    document = d.descriptor
    _rewrite(d, lambda _: json.dumps({"spec_version": "0.1", "documents": [document]}).encode())


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/tolerances/evidence"})
def tolerance_that_hides_wrong_evidence(d: Draft) -> None:
    d.descriptor["tolerances"] = {"evidence": 0.1}


@mutant("BD-DOC-003", at={**PLACE, "pointer": "/tolerances/actuator"})
def tolerance_that_hides_wrong_commands(d: Draft) -> None:
    d.descriptor["tolerances"] = {"actuator": 0.03}


@boundary("BD-DOC-003")
def tolerances_at_their_limits(d: Draft) -> None:
    d.descriptor["tolerances"] = {"actuator": 0.02, "evidence": 0.001}


@boundary("BD-DOC-003")
def descriptor_values_at_their_limits(d: Draft) -> None:
    d.descriptor["title"] = "ü" * 200
    d.descriptor["dataset_id"] = "0" + "-" * 127
    d.descriptor["dataset_version"] = "999999.0.0"
    d.descriptor["collection"] = {"seed": 2**63 - 1, "replay_noise": 100, "faults": {"stall": 1}}
    d.descriptor["rates"] = {"tick_s": 0.05, "observation_stride_ticks": 5.0}


# BD-DOC-004


@mutant("BD-DOC-004", at={**PLACE, "pointer": "/action_bank"})
def action_key_twice(d: Draft) -> None:
    policies = d.descriptor["action_bank"]["policies"]
    policies[2]["key"] = policies[1]["key"]


@mutant("BD-DOC-004", at={**PLACE, "pointer": "/action_bank"})
def two_nominal_policies(d: Draft) -> None:
    policies = d.descriptor["action_bank"]["policies"]
    policies.append({**policies[0], "key": "nominal.again"})


@mutant("BD-DOC-004", at={**PLACE, "pointer": "/action_bank"})
def nominal_policy_that_intervenes(d: Draft) -> None:
    d.descriptor["action_bank"]["policies"][0]["steer"] = {"rule": "zero"}


@mutant("BD-DOC-004", at={**PLACE, "pointer": "/action_bank"})
def intervention_without_recovery(d: Draft) -> None:
    d.descriptor["action_bank"]["policies"][5]["recovery"] = "none"


@mutant("BD-DOC-004", base="media", at=PLACE)
def camera_twice(d: Draft) -> None:
    d.descriptor["cameras"].append(dict(d.descriptor["cameras"][0]))


@boundary("BD-DOC-004", "BD-FRM-001", base="media")
def camera_that_no_claimed_stream_needs(d: Draft) -> None:
    d.descriptor["cameras"].append({**d.descriptor["cameras"][0], "name": "dashboard"})
    d.duplicate("frames", {"camera": "dashboard"}, rollout_id="g0.nominal.a1", camera="rear", tick=BRANCH_TICK)


# BD-DOC-005


@mutant("BD-DOC-005", at={**PLACE, "pointer": "/title"})
def title_with_a_path(d: Draft) -> None:
    d.descriptor["title"] = "Runs of /data/collect/2026"


@boundary("BD-DOC-005")
def title_with_a_date_and_an_address(d: Draft) -> None:
    d.descriptor["title"] = "Runs of 2026-03-01, https://example.org/runs/1 or mail@example.org"


# BD-DOC-006


@mutant("BD-DOC-006", at={**PLACE, "pointer": "/collection/scenario_types"})
def scenario_type_that_no_plan_names(d: Draft) -> None:
    d.descriptor["collection"]["scenario_types"] = ["HardBreakRoute2"]


@boundary("BD-DOC-006")
def scenario_type_of_which_nothing_was_collected(d: Draft) -> None:
    collected = set(d.take("rollouts")["scenario_type"].to_pylist())
    d.descriptor["collection"]["scenario_types"] = sorted({*collected, "HardBreakRoute2"})


# BD-ENC-001


@mutant("BD-ENC-001", at=ENCODING)
def digest_of_another_matrix(d: Draft) -> None:
    d.descriptor["action_encoding"]["sha256"] = "0" * 64


@mutant("BD-ENC-001", at=ENCODING)
def bank_permuted_behind_the_digest(d: Draft) -> None:
    policies = d.descriptor["action_bank"]["policies"]
    policies[3], policies[4] = policies[4], policies[3]


@mutant("BD-ENC-001", at={**PLACE, "pointer": "/action_encoding"})
def family_that_the_encoding_does_not_know(d: Draft) -> None:
    d.descriptor["action_bank"]["policies"][1]["family"] = "swerve"


@boundary("BD-ENC-001")
def permuted_bank_with_its_own_digest(d: Draft) -> None:
    d.descriptor["action_bank"]["policies"].reverse()
    bank = ActionBank.model_validate(d.descriptor["action_bank"])
    d.descriptor["action_encoding"]["sha256"] = encoding_digest(bank)


@boundary("BD-ENC-001", status="skipped", verdict="partial")
def encoding_of_another_name(d: Draft) -> None:
    d.descriptor["action_encoding"] = {"name": "own8", "width": 8, "sha256": "0" * 64}


@boundary("BD-ENC-001", status="skipped")
def no_encoding(d: Draft) -> None:
    del d.descriptor["action_encoding"]
