"""A detached release is judged as far as it goes, and in full with its raw layer named; with any other it is not."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from tests.synthetic import seal_dataset, write_dataset
from tests.validator.release.running import build, call_validate, contents
from tests.validator.release.test_stages import another_raw_layer, stored_otherwise

from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.rule import CATALOGUE
from branchdrive.formats.parquet import encode_table

NAME_RAW = "the raw layer is not available; give its dataset with --raw"

ABSENT = ("BD-LKG", "BD-MOD-022", "BD-MOD-023")
"""Rules on an audit of leakage and on the tables of endings and objects, which are not there."""


@pytest.fixture(scope="module")
def detached(raw: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of a detached release of `raw`; read-only by agreement."""
    root = tmp_path_factory.mktemp("detached") / "release"
    build(raw, output=root)
    return root


def open_claims(report: dict[str, Any]) -> set[str]:
    """Claims about layers that were not judged, those about what the release does without apart."""
    skipped = {rule["id"] for rule in report["rules"] if rule["status"] == "skipped" and CATALOGUE[rule["id"]].layer}
    return {rule for rule in skipped if not rule.startswith(ABSENT)}


def test_alone_it_is_partial_and_says_what_to_name(detached: Path) -> None:
    code, out, err = call_validate(detached)
    assert (code, err) == (3, "")
    assert NAME_RAW in out
    assert "Verdict: partial" in out


def test_alone_its_groups_are_those_that_it_claims(built: Path, detached: Path) -> None:
    stages = json.loads((built / "quality/population.json").read_bytes())["stages"]
    claimed, frozen = stages[0]["total"], stages[-1]["total"]
    for form in ("text", "markdown"):
        out = call_validate(detached, "--format", form)[1]
        assert f"{claimed} branch groups as the release claims; no raw layer to count rollouts in" in out
        assert f"; {frozen} of {claimed} groups qualify" in out


def test_alone_only_what_needs_raw_is_left_open(detached: Path) -> None:
    code, out, _ = call_validate(detached, "--format", "json")
    document = json.loads(out)
    assert (code, document["verdict"]) == (3, "partial")
    assert schema_mismatches(document, "report.schema.json") == []
    needs_raw = {rule for rule, info in CATALOGUE.items() if info.needs_raw and not rule.startswith(ABSENT)}
    assert open_claims(document) == needs_raw


def test_with_its_raw_layer_it_is_valid(detached: Path, raw: Path) -> None:
    before = contents(raw), contents(detached)
    code, out, err = call_validate(detached, "--raw", raw)
    assert (code, err) == (0, "")
    assert "Verdict: valid" in out
    assert (contents(raw), contents(detached)) == before
    document = json.loads(call_validate(detached, "--raw", raw, "--format", "json")[1])
    assert schema_mismatches(document, "report.schema.json") == []
    assert open_claims(document) == set()


def test_the_whole_dataset_serves_as_its_raw_layer_too(detached: Path, built: Path) -> None:
    assert call_validate(detached, "--raw", built)[0] == 0


def test_a_raw_layer_that_is_stored_otherwise_is_the_same(detached: Path, raw: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    write_dataset(other, stored_otherwise(raw), parse_json((raw / "branchdrive.json").read_bytes()))
    code, out, _ = call_validate(detached, "--raw", other)
    assert (code, "Verdict: valid" in out) == (0, True)


def test_with_another_raw_layer_it_is_invalid(detached: Path, raw: Path, tmp_path: Path) -> None:
    other = another_raw_layer(raw, tmp_path / "other")
    code, out, _ = call_validate(detached, "--raw", other, "--format", "json")
    document = json.loads(out)
    assert (code, document["verdict"]) == (1, "invalid")
    failed = {rule["id"] for rule in document["rules"] if rule["status"] == "fail" and CATALOGUE[rule["id"]].layer}
    assert failed == {"BD-REL-001"}


def test_with_a_damaged_raw_layer_it_is_not_valid(detached: Path, dataset: Path) -> None:
    shutil.rmtree(dataset / "raw/shard-00002")
    seal_dataset(dataset)
    code, out, _ = call_validate(detached, "--raw", dataset)
    assert code == 1
    assert "BD-REL-001" in out


def test_no_more_of_its_groups_qualify_than_do_in_the_raw_layer(detached: Path, dataset: Path) -> None:
    for path in dataset.glob("raw/*/observations.parquet"):
        table = pq.read_table(path)
        place = table.schema.get_field_index("speed_mps")
        speeds = pc.multiply(table["speed_mps"], 3.6).cast(table.schema.field(place).type)
        path.write_bytes(encode_table(table.set_column(place, table.schema.field(place), speeds)))
    seal_dataset(dataset)
    code, out, _ = call_validate(detached, "--raw", dataset)
    assert code == 1
    assert re.search(r"; 0 of \d+ groups qualify", out)


def test_rules_on_rows_are_claimed_by_the_dataset_that_has_them(detached: Path, raw: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(detached, tmp_path / "other"))
    document = json.loads((root / "branchdrive.json").read_bytes())
    document["streams"].remove("actor_risk_evidence")
    (root / "branchdrive.json").write_text(json.dumps(document))
    seal_dataset(root)
    rules = {rule["id"]: rule for rule in json.loads(call_validate(root, "--raw", raw, "--format", "json")[1])["rules"]}
    alone = {rule["id"]: rule for rule in json.loads(call_validate(root, "--format", "json")[1])["rules"]}
    assert (rules["BD-EVD-002"]["status"], alone["BD-EVD-002"]["status"]) == ("pass", "not-claimed")


def test_a_dataset_with_its_raw_layer_takes_no_other(built: Path, raw: Path) -> None:
    code, out, err = call_validate(built, "--raw", raw)
    assert (code, out) == (2, "")
    assert "holds its raw layer itself; leave out --raw" in err
    assert err.count("\n") == 1


def test_a_report_inside_the_raw_dataset_is_refused(detached: Path, dataset: Path) -> None:
    before = contents(dataset)
    code, out, err = call_validate(detached, "--raw", dataset, "--output", dataset / "report.txt")
    assert (code, out) == (2, "")
    assert "lies inside the dataset" in err
    assert contents(dataset) == before


@pytest.mark.parametrize("name", ["nowhere", "empty", "file"])
def test_raw_must_be_a_dataset(detached: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    code, out, err = call_validate(detached, "--raw", tmp_path / name)
    assert (code, out) == (2, "")
    assert err[:-1].isprintable()


def test_a_release_is_not_its_own_raw_layer(detached: Path) -> None:
    code, out, err = call_validate(detached, "--raw", detached)
    assert (code, out) == (2, "")
    assert err.startswith("branchdrive-validate: ")
    assert err.count("\n") == 1


def test_required_groups_are_counted_in_the_frozen_population(built: Path, detached: Path, raw: Path) -> None:
    population = json.loads((built / "quality/population.json").read_bytes())
    totals = {stage["stage"]: stage["total"] for stage in population["stages"]}
    frozen = totals["frozen"]
    assert frozen < totals["core_valid"] < totals["eligible"]
    assert call_validate(built, "--require-groups", frozen)[0] == 0
    code, out, _ = call_validate(built, "--require-groups", frozen + 1)
    assert code == 1
    assert f"{frozen} of {frozen + 1} required branch groups qualify" in out
    assert call_validate(detached, "--raw", raw, "--require-groups", frozen)[0] == 0
    assert call_validate(detached, "--raw", raw, "--require-groups", frozen + 1)[0] == 1
    assert call_validate(detached, "--require-groups", frozen)[0] == 3
    assert call_validate(detached, "--require-groups", frozen + 1)[0] == 1
