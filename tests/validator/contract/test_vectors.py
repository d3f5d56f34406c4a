"""Vectors for readers of any language: they are fresh, and the library gives them."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.each import each
from tests.synthetic_map import map_descriptor
from tests.validator.contract.vectors import FOLDER, VECTORS, text

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import TABLES, declared_table, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.encoding import encode_bank, encode_policy
from branchdrive.contract.identity import content_identity, derived_content, document_digest
from branchdrive.contract.policy import Policy
from branchdrive.contract.resources import load_resource
from branchdrive.driving.box import Boxes, box_gap
from branchdrive.driving.risk import risk_evidence
from branchdrive.driving.route import project
from branchdrive.files.shard_facts import ShardFacts
from branchdrive.formats.manifest import Manifest
from branchdrive.quality.variants import variants_document
from branchdrive.raw.content import group_content, raw_content, table_content
from branchdrive.raw.shard_view import ShardView
from branchdrive.statistics.split import split_digest
from branchdrive.tables.content import table_digest

AGREE = {"rtol": 1e-9, "atol": 1e-9}
RISK = load_resource("vectors/risk.json")
ENCODING = load_resource("vectors/encoding.json")
DIGESTS = load_resource("vectors/digests.json")
PROJECTION = load_resource("vectors/projection.json")
CONTENT = load_resource("vectors/content.json")


@pytest.mark.parametrize("name", VECTORS)
def test_vectors_are_those_of_second_implementations(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == text(name)


def actor_columns(scene: dict[str, Any]) -> dict[str, Any]:
    columns = ("actor_id", "actor_class", "x_m", "y_m", "yaw_rad", "length_m", "width_m", "vel_x_mps", "vel_y_mps")
    rows = {name: np.array([actor[name] for actor in scene["actors"]]) for name in columns}
    return {**rows, "tick": np.zeros(len(scene["actors"]), np.int64)}


@each("scene", RISK["scenes"], ids=lambda scene: scene["title"])
def test_risk(scene: dict[str, Any]) -> None:
    ego, actors = scene["ego"], actor_columns(scene)
    observations = {name: np.array([ego[name]]) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")}
    found = risk_evidence(
        {**observations, "tick": np.array([0])},
        actors,
        ego_length_m=ego["length_m"],
        ego_width_m=ego["width_m"],
        route_x_m=np.array(RISK["route_x_m"]),
        route_y_m=np.array(RISK["route_y_m"]),
    )
    for column, expected in scene["evidence"].items():
        value = found[column][0]
        if expected is None:
            assert value is np.ma.masked, column
        else:
            np.testing.assert_allclose(value, expected, **AGREE, err_msg=column)


@each("scene", [scene for scene in RISK["scenes"] if scene["actors"]], ids=lambda scene: scene["title"])
def test_gaps(scene: dict[str, Any]) -> None:
    def boxes(bodies: list[dict[str, Any]]) -> Boxes:
        extents = ("x_m", "y_m", "yaw_rad", "length_m", "width_m")
        return Boxes(*(np.array([body[name] for body in bodies], np.float64) for name in extents))

    gap = box_gap(boxes([scene["ego"]] * len(scene["actors"])), boxes(scene["actors"])).gap_m
    np.testing.assert_allclose(gap, [actor["gap_m"] for actor in scene["actors"]], **AGREE)


@each("case", PROJECTION["polylines"], ids=lambda case: case["title"])
def test_projection(case: dict[str, Any]) -> None:
    x, y = (np.array([point[name] for point in case["points"]]) for name in ("x_m", "y_m"))
    found = project(x, y, np.array(case["x_m"]), np.array(case["y_m"]))
    for name, values in found._asdict().items():
        np.testing.assert_allclose(values, [point[name] for point in case["points"]], **AGREE)


def test_projection_of_single_points() -> None:
    for case in PROJECTION["polylines"]:
        for point in case["points"]:
            found = project(
                *(np.array([point[name]]) for name in ("x_m", "y_m")), np.array(case["x_m"]), np.array(case["y_m"])
            )
            assert found.progress_m[0] == pytest.approx(point["progress_m"], abs=1e-9)


def stored(name: str) -> pa.Table:
    """A table of the vectors on content."""
    case = CONTENT["tables"][name]
    names = [column["name"] for column in case["columns"]]
    rows = [dict(zip(names, row, strict=True)) for row in case["rows"]]
    return pa.Table.from_pylist(rows, schema=table_schema(name))


@each("name", list(CONTENT["tables"]))
def test_content_of_tables(name: str) -> None:
    case, table = CONTENT["tables"][name], stored(name)
    declared = declared_table(name)
    assert case["key"] == list(declared.key)
    assert case["columns"] == [{"name": c.name, "type": c.type, "may_be_null": c.nullable} for c in declared.columns]
    assert table_digest(name, table) == case["block"]
    assert table_digest(name, table.take(np.arange(len(table))[::-1])) == case["block"]


def test_content_of_groups_and_layers() -> None:
    tables = {name: stored(name) for name in TABLES if name not in ("frames", "decisions")}
    view = ShardView(tables, Descriptor.model_validate(map_descriptor()))
    found = {name: digest.hex() for name, (digest,) in table_content(view, view.group).items()}
    (group,) = CONTENT["groups"].values()
    assert found == group["blocks"]
    groups = group_content(view)
    assert groups is not None
    assert dict(zip(view.group_ids, (one.tobytes().hex() for one in groups), strict=True)) == {
        one: case["sha256"] for one, case in CONTENT["groups"].items()
    }
    (town,) = set(tables["map"]["town"].to_pylist())
    assert CONTENT["maps"] == {f"map {town}": table_digest("map", tables["map"])}
    facts = ShardFacts(
        "raw/shard-00000", group_ids=view.group_ids, groups=groups, maps={town: table_digest("map", tables["map"])}
    )
    documents = {path: document_digest(case["value"]) for path, case in CONTENT["documents"].items()}
    parts = {"canonical/attempts-00000.parquet": table_digest("attempts", stored("attempts")), **documents}
    assert parts == CONTENT["parts"]
    layers = {"raw": raw_content([facts]), **derived_content(parts, parts)}
    assert layers == CONTENT["layers"]
    assert content_identity(layers, ("raw", "canonical")) == CONTENT["identity"]


def test_encoding() -> None:
    policies = [Policy.model_validate(case["policy"]) for case in ENCODING["policies"]]
    for policy, case in zip(policies, ENCODING["policies"], strict=True):
        assert encode_policy(policy).astype(np.float64).tolist() == case["vector"]
    by_key = {policy.key: policy for policy in policies}
    for case in ENCODING["matrices"]:
        matrix = np.stack([encode_policy(by_key[key]) for key in case["keys"]]).astype("<f4")
        assert hashlib.sha256(matrix.tobytes()).hexdigest() == case["sha256"]


def test_encoding_of_a_bank() -> None:
    bank = ActionBank.model_validate({"name": "vectors", "policies": [case["policy"] for case in ENCODING["policies"]]})
    assert hashlib.sha256(encode_bank(bank).astype("<f4").tobytes()).hexdigest() == ENCODING["matrices"][0]["sha256"]


def test_digests() -> None:
    files = {case["path"]: hashlib.sha256(case["text"].encode()).hexdigest() for case in DIGESTS["files"]}
    assert files == {case["path"]: case["sha256"] for case in DIGESTS["files"]}
    manifest = Manifest.of(files)
    assert dict(manifest.layers) == DIGESTS["layers"]
    assert manifest.identity == DIGESTS["identity"]
    assert manifest.render().decode() == DIGESTS["manifest"]
    assert split_digest(DIGESTS["split"]["partitions"]) == DIGESTS["split"]["sha256"]


def test_digest_of_a_population() -> None:
    names = np.array(DIGESTS["population"]["groups"], object)
    flags = {"core_valid": np.ones(len(names), bool), "extended_valid": np.zeros(len(names), bool)}
    groups = {"group_id": names, **flags, "near_duplicate": np.zeros(len(names), bool)}
    assert variants_document(groups)["frozen"]["digest"] == DIGESTS["population"]["sha256"]
