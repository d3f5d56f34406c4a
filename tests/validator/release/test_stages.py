"""Stages alone and in order make the same release; one that lacks its predecessor is refused; accesses are kept."""

from __future__ import annotations

import json
import shutil
from itertools import product
from pathlib import Path

import pyarrow as pa
import pytest
from tests.content_cache import kept_folder
from tests.sampling import sampled
from tests.synthetic import seal_dataset, write_dataset
from tests.synthetic_release import NUM_GROUPS, SEED, raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft
from tests.validator.release.running import breaches, build, call, contents
from tests.validator.release.test_determinism import shuffled

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.layout import LEDGER_FILE as LEDGER
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.release.builder import STAGES

pytestmark = pytest.mark.usefixtures("audit_in_this_process")


@pytest.fixture(scope="module")
def rebuilt(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Root of the same release after a second build with another seed; read-only by agreement."""

    def rebuild(root: Path) -> None:
        shutil.copytree(built, root)
        build(root, seed=1)

    return kept_folder("opened-release", rebuild, tmp_path_factory.mktemp("rebuilt") / "dataset")


def entries(root: Path) -> list[dict[str, object]]:
    """Entries of the ledger."""
    found: list[dict[str, object]] = parse_json((root / LEDGER).read_bytes())["entries"]
    return found


def another_raw_layer(raw: Path, root: Path) -> Path:
    """A dataset with the same groups, one of whose attempts ended for another reason."""
    tables = stored_otherwise(raw)
    rollouts = next(iter(tables.values()))["rollouts"]
    place = rollouts.schema.get_field_index("result_termination")
    reasons = ["recorded again", *rollouts["result_termination"].to_pylist()[1:]]
    changed = rollouts.set_column(place, rollouts.schema.field(place), pa.array(reasons, pa.string()))
    next(iter(tables.values()))["rollouts"] = changed
    write_dataset(root, tables, parse_json((raw / "branchdrive.json").read_bytes()))
    return root


def stored_otherwise(raw: Path) -> dict[str, dict[str, pa.Table]]:
    """Tables of the shards of a dataset, with rows in another order."""
    folders = sorted(path.relative_to(raw).as_posix() for path in (raw / "raw").iterdir())
    return {folder: shuffled(raw, folder, 9) for folder in folders}


def test_stages_alone_and_in_order_make_the_same_release(dataset: Path, audited: Path) -> None:
    for stage in STAGES:
        build(dataset, stages=[stage])
        assert breaches(dataset) == set(), stage
    assert contents(dataset) == contents(audited)


def test_stages_are_carried_out_in_their_own_order(dataset: Path, built: Path) -> None:
    build(dataset, stages=["model", "quality", "canonical"])
    assert contents(dataset) == contents(built)


def test_a_shard_without_a_complete_group_takes_part(tmp_path: Path) -> None:
    d = Draft(raw_tables(), raw_descriptor())
    ids = d.tables["raw/shard-00002"]["rollouts"]["rollout_id"].to_pylist()
    d.set("rollouts", "status", "partial", rollout_id=ids)
    d.set("rollouts", "status_reason", "the server was lost", rollout_id=ids)
    root = d.write(tmp_path / "dataset")
    build(root, seed=0)
    assert validate(root).verdict == "valid"
    assert validate(root).dataset.num_groups == NUM_GROUPS


def test_each_stage_claims_what_is_there(dataset: Path) -> None:
    for stage, layers in (
        ("canonical", ["raw", "canonical"]),
        ("quality", ["raw", "canonical", "quality"]),
        ("model", ["raw", "canonical", "quality", "model"]),
    ):
        report = build(dataset, stages=[stage])
        assert parse_json((dataset / "branchdrive.json").read_bytes())["layers"] == layers
        assert report.layers == tuple(layers[1:])
        assert (dataset / "README.md").exists() == ("quality" in layers)


@pytest.mark.parametrize(("stage", "needed"), [("quality", "canonical"), ("leakage", "quality"), ("model", "quality")])
def test_a_stage_without_the_one_before_it_is_refused(dataset: Path, stage: str, needed: str) -> None:
    before = contents(dataset)
    if needed == "quality":
        build(dataset, stages=["canonical"])
        before = contents(dataset)
    with pytest.raises(UsageError, match=f"the stage '{stage}' needs the layer '{needed}', which is not there"):
        build(dataset, stages=[stage])
    assert contents(dataset) == before


def test_layers_of_another_raw_layer_are_refused(raw: Path, release: Path, tmp_path: Path) -> None:
    other = another_raw_layer(raw, tmp_path / "other")
    before = contents(release)
    shutil.rmtree(release / "raw")
    shutil.copytree(other / "raw", release / "raw")
    seal_dataset(release)
    before = contents(release)
    for stage in STAGES[1:]:
        with pytest.raises(
            UsageError, match="its layers were built from another raw layer; start with the stage 'canonical'"
        ):
            build(release, stages=[stage])
    assert contents(release) == before
    with pytest.raises(UsageError, match="build 'quality' together with 'canonical'"):
        build(release, stages=["canonical"])
    assert contents(release) == before
    build(release)
    assert validate(release).verdict == "valid"
    assert [entry["number"] for entry in entries(release)] == [1, 2, 3]  # the same split of the same groups


def test_layers_of_another_raw_layer_in_a_detached_release_are_refused(raw: Path, tmp_path: Path) -> None:
    release, other = tmp_path / "release", another_raw_layer(raw, tmp_path / "other")
    build(raw, output=release)
    before = contents(release)
    with pytest.raises(UsageError, match="its layers were built from another raw layer"):
        build(other, output=release, stages=["model"])
    assert contents(release) == before


def test_another_seed_drops_what_follows_and_adds_to_the_ledger(audited: Path, tmp_path: Path) -> None:
    release = shutil.copytree(audited, tmp_path / "release")
    first = entries(release)
    build(release, seed=1, stages=["quality"])
    assert not (release / "model").exists()
    assert not (release / "quality/leakage.json").exists()
    assert entries(release)[:3] == first
    assert [entry["number"] for entry in entries(release)] == [1, 2, 3, 4, 5, 6]
    assert "Leakage was not audited" in (release / "README.md").read_text()
    report = validate(release)
    assert report.verdict == "valid"
    (told,) = (tally for tally in report.tallies if tally.rule_id == "BD-FID-012")
    assert told.num_findings == 1


def test_a_test_partition_that_was_opened_twice_is_told(release: Path) -> None:
    once = "The test partition was accessed once"
    assert once in (release / "README.md").read_text()
    code, out, _ = call("build", release, "--seed", "1", "--no-leakage")
    assert code == 0
    for text in (out, (release / "README.md").read_text()):
        assert once not in text
        assert "The test partition was accessed 2 times" in text


def test_a_rebuild_with_the_same_options_opens_nothing_and_keeps_the_audit(audited: Path, tmp_path: Path) -> None:
    release = shutil.copytree(audited, tmp_path / "release")
    build(release)
    assert contents(release) == contents(audited)


def test_an_audit_that_is_left_out_is_gone(audited: Path, built: Path, tmp_path: Path) -> None:
    release = shutil.copytree(audited, tmp_path / "release")
    assert "Leakage was not audited" not in (release / "README.md").read_text()
    code, out, _ = call("build", release, "--no-leakage", "--seed", str(SEED))
    assert code == 0
    assert "Leakage was not audited" in out
    assert contents(release) == contents(built)
    release = shutil.copytree(audited, tmp_path / "again")
    assert call("build", release, "--no-leakage", "--stage", "model")[0] == 0
    assert contents(release) == contents(built)
    with pytest.raises(UsageError, match="either carried out or left out"):
        build(release, stages=STAGES, drop_leakage=True)


READ_AGAIN = (
    "canonical/records-00000.parquet",
    "quality/pairs-00000.parquet",
    "quality/split.json",
    "canonical/source.json",
)


@pytest.mark.parametrize(("path", "damage"), sampled(product(READ_AGAIN, ("gone", "cut", "other")), every=5))
def test_the_ledger_outlives_a_broken_file(rebuilt: Path, built: Path, tmp_path: Path, path: str, damage: str) -> None:
    release = shutil.copytree(rebuilt, tmp_path / "release")
    match damage:
        case "gone":
            (release / path).unlink()
        case "cut":
            (release / path).write_bytes((release / path).read_bytes()[:99])
        case "other":
            (release / path).write_bytes((built / path).read_bytes() + b" ")
    build(release, seed=1)
    assert [entry["number"] for entry in entries(release)] == [1, 2, 3, 4, 5, 6]
    assert validate(release).verdict == "valid"


def test_a_layer_that_is_not_as_the_manifest_has_it_is_no_base(release: Path) -> None:
    document = parse_json((release / "quality/split.json").read_bytes())
    (release / "quality/split.json").write_bytes(dump_json({**document, "seed": 99}))
    with pytest.raises(UsageError, match="the stage 'model' needs the layer 'quality', which is not there"):
        build(release, stages=["model"])


def test_variants_are_counted_beside_the_frozen_population(dataset: Path, tmp_path: Path) -> None:
    wanted = [{"name": "eligible", "title": "Structurally eligible", "where": {"eligible": True}}]
    (tmp_path / "variants.json").write_text(json.dumps(wanted))
    code, out, err = call("build", dataset, "--no-leakage", "--variants", tmp_path / "variants.json")
    assert (code, err) == (0, "")
    assert out
    variants = parse_json((dataset / "quality/variants.json").read_bytes())["variants"]
    assert [variant["name"] for variant in variants] == ["extended", "eligible"]
    assert validate(dataset).verdict == "valid"


def test_the_command_prints_what_it_built(dataset: Path) -> None:
    code, out, err = call("build", dataset, "--no-leakage", "--format", "json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["layers"] == ["canonical", "quality", "model"]
    assert document["identity"] == validate(dataset).dataset.identity
    assert document["population"] == parse_json((dataset / "quality/population.json").read_bytes())
    assert document["retention"] == parse_json((dataset / "quality/retention.json").read_bytes())
    code, out, _ = call("build", dataset, "--no-leakage")
    assert code == 0
    assert f"identity {document['identity']}" in out
    assert "Leakage was not audited" in out
