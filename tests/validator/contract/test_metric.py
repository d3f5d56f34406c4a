"""Metrics are declared once; schemas, the protocol and the chapter follow."""

from __future__ import annotations

import json

import pytest

from branchdrive.contract import metric
from branchdrive.contract.generate.record import metric_schemas, protocol_text
from branchdrive.contract.metric import DECLARED_METRICS, DeclaredMetric, metric_names
from branchdrive.contract.resources import load_resource, schema_dir

TARGETS = load_resource("benchmark-protocol.json")["targets"]


def test_names_differ_and_those_without_values_of_groups_are_of_targets() -> None:
    names = metric_names(TARGETS)
    assert len(set(names)) == len(names)
    assert all(declared.per_target for declared in DECLARED_METRICS if not declared.paired)
    assert set(metric_names(TARGETS, paired_only=True)) < set(names)


@pytest.mark.parametrize("paired", [True, False])
def test_another_entry_is_in_every_list(paired: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    another = DeclaredMetric("median_error", "Median error", "target", True, 0, paired, "Another one.")
    monkeypatch.setattr(metric, "DECLARED_METRICS", (*DECLARED_METRICS, another))
    added = {f"median_error.{target}" for target in TARGETS}
    schemas = metric_schemas()
    protocol = schemas["protocol.schema.json"]["properties"]
    tests = protocol["families"]["items"]["oneOf"][0]["properties"]["members"]["items"]["properties"]["metric"]["enum"]
    text = protocol_text((schema_dir() / "benchmark-protocol.json").read_text("utf-8"))
    assert added <= set(protocol["metrics"]["const"])
    assert added <= set(schemas["results.schema.json"]["$defs"]["estimate"]["properties"]["metric"]["enum"])
    assert added.issubset(tests) == paired
    assert json.loads(text) == {
        **load_resource("benchmark-protocol.json"),
        "metrics": [*load_resource("benchmark-protocol.json")["metrics"], *sorted(added, key=text.index)],
    }
