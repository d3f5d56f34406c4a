"""Models of images in a benchmark: under a second lock, reported apart, and left out where there are no images."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.reference_impl.benchmark.small_release import (
    ASSIGNMENT,
    invoke,
    is_clean,
    make_release,
    protocol,
    write_protocol,
)
from tests.reference_impl.learning.small_models import VISUAL
from tests.small_images import add_images

from branchdrive import validate
from branchdrive.benchmark.protocol.protocol import default_protocol, protocol_problem, visual_protocol
from branchdrive.contract.document import dump_json
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.quality.ledger import BENCHMARK_ACCESSES, accesses
from branchdrive_reference.benchmark import latency
from branchdrive_reference.benchmark.document import published_protocol, read_protocol_file, untrained_sentence
from branchdrive_reference.benchmark.release import Release, open_release


def small_visual() -> dict[str, Any]:
    """The small protocol with small models of images, of one seed each, and a guard on M5."""
    document, wanted = protocol(max_epochs=1), visual_protocol().document
    document["models"] = [model for model in document["models"] if model["id"] in ("M0", "M3")]
    for model in (model for model in wanted["models"] if model["id"] in VISUAL):
        configuration = VISUAL[model["id"]].record
        configuration["training"]["max_epochs"] = 1
        document["models"].append({**model, "configuration": configuration})
    for model in document["models"]:
        model["seeds"] = model["seeds"][:1]
    guard = {**document["guard"], "further_models": ["M5"]}
    return {**document, "name": "small-visual", "guard": guard, "selection": wanted["selection"]}


@pytest.fixture(scope="module")
def looked_at(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A release with images whose structured models were evaluated first, and then all of them."""
    folder = tmp_path_factory.mktemp("visual")
    root = add_images(make_release(folder / "release"), ASSIGNMENT)
    write_manifest(Folder(root), build_manifest(Folder(root)))
    structured = {**small_visual(), "name": "small-structured"}
    structured["models"] = structured["models"][:2]
    structured["guard"] = {name: value for name, value in structured["guard"].items() if name != "further_models"}
    first = write_protocol(folder / "structured.json", structured)
    invoke("benchmark", root, "--protocol", first, "--no-figures", "--no-guard")
    second = write_protocol(folder / "visual.json", small_visual())
    invoke("benchmark", root, "--protocol", second, "--no-figures")
    return root


def document(root: Path, name: str) -> Any:
    return json.loads((root / f"benchmark/{name}.json").read_bytes())


def test_the_second_lock_records_the_second_access(looked_at: Path) -> None:
    assert is_clean(looked_at)
    lock, ledger = document(looked_at, "lock"), document(looked_at, "ledger")
    assert [entry["model"] for entry in lock["checkpoints"]] == ["M0", "M3", "M4", "M5", "M6"]
    assert [len(accesses(event, ledger)) for event in BENCHMARK_ACCESSES] == [2, 2]
    assert any("2 times for predictions" in warning for warning in document(looked_at, "results")["warnings"])


def test_families_count_what_is_there(looked_at: Path) -> None:
    results = document(looked_at, "results")
    families = {
        family["name"]: (family["num_declared"], family["num_evaluated"])
        for family in (*results["prediction"]["families"], *results["ranking"]["families"])
    }
    assert families["full"] == (9, 5)  # M1 and M2 are none of this protocol
    assert families["ranking_full"] == (24, 24)
    assert [guard["model"] for guard in results["further_guards"]] == ["M3", "M5", "M5"]


def test_what_sees_more_than_sensors_is_reported_apart(looked_at: Path) -> None:
    results, tables = document(looked_at, "results"), (looked_at / "benchmark/TABLES.md").read_text("utf-8")
    assert [model["id"] for model in results["models"] if model.get("reported_apart")] == ["M6"]
    parts = {part.split("\n")[0]: part for part in tables.split("\n## ")}
    assert "M6" not in parts["Prediction"]
    assert "| M6† Semantic BEV and action |" in parts["Prediction, privileged"]
    assert "† reads what no sensor of the vehicle tells" in parts["Prediction, privileged"]
    assert "| O-M5 |" in parts["Ranking, profile balanced"] and "O-M6" not in parts["Ranking, profile balanced"]
    assert "| O-M6 |" in parts["Ranking, profile balanced, privileged"]


def test_models_of_cameras_are_timed_as_such(looked_at: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latency, "EXPORT", ("no_such_package",))
    root = shutil.copytree(looked_at, tmp_path / "release")
    invoke("latency", root, "--repeats", "1")
    assert is_clean(root)
    models = document(root, "latency")["models"]
    assert [model["model"] for model in models if model.get("reads_cameras")] == ["M4", "M5"]
    assert "M4, M5: torch decodes and encodes the 96 images" in (root / "benchmark/TABLES.md").read_text("utf-8")
    report = {tally.rule_id: tally.status for tally in validate(root).tallies}
    assert {report[rule] for rule in ("BD-BMK-013", "BD-BMK-016")} == {"pass"}


def test_normative_protocols_differ_by_models_of_images_alone() -> None:
    visual, structured = visual_protocol().document, default_protocol().document
    assert [model["id"] for model in visual["models"]] == [m["id"] for m in structured["models"]] + list(VISUAL)
    assert visual["models"][: len(structured["models"])] == structured["models"]
    assert visual["guard"] == {**structured["guard"], "further_models": ["M5"]}
    own = ("name", "version", "models", "guard")
    assert {k: v for k, v in visual.items() if k not in own} == {k: v for k, v in structured.items() if k not in own}
    sizes = {family.name: len(family.members) for family in visual_protocol().families}
    assert (sizes["full"], sizes["ranking_full"]) == (9, 24)


def test_another_protocol_does_not_carry_its_name() -> None:
    changed = {**visual_protocol().document, "outcomes": {"contact_m": 0.1}}
    assert "'branchdrive-benchmark-visual' 0.1.0 and is not the protocol of that name" in str(protocol_problem(changed))
    assert protocol_problem({**changed, "name": "mine"}) is None


def opened(root: Path, **changes: Any) -> Release:
    about = json.loads((root / "branchdrive.json").read_bytes())
    (root / "branchdrive.json").write_bytes(dump_json({**about, **changes}))
    write_manifest(Folder(root), build_manifest(Folder(root)))
    return open_release(root)


def test_images_decide_which_protocol_is_the_default(release: Path) -> None:
    detached = open_release(release)
    assert published_protocol(detached) == default_protocol()
    no_images = (
        "M4, M5, M6 are not trained: the release has no images of rgb_surround, semantic_bev; `branchdrive render` "
        "draws them for a dataset, `branchdrive collect --media` while it is collected, and a release of that has them"
    )
    assert untrained_sentence(detached, default_protocol()) == no_images
    layers = detached.layer.descriptor.layers
    lacking = opened(release, layers=["raw", *layers])
    assert untrained_sentence(lacking, published_protocol(lacking)) == no_images
    assert untrained_sentence(lacking, default_protocol(), ["M3", "M9"]) is None  # nobody asked for them
    assert untrained_sentence(lacking, default_protocol(), ["M5"]) == no_images
    assert untrained_sentence(lacking, visual_protocol()) is None
    add_images(release, ASSIGNMENT)
    seeing = opened(release)
    assert published_protocol(seeing) == visual_protocol()
    assert untrained_sentence(seeing, default_protocol()) is None  # somebody chose it
    assert untrained_sentence(opened(release, layers=layers), default_protocol()) == (
        "M4, M5, M6 are not trained: the release is here without its raw layer, where images lie and outcomes repeat; "
        "`branchdrive build DATASET` without `--output` makes a release in place, to benchmark instead"
    )


def test_normative_protocols_have_names() -> None:
    assert read_protocol_file(Path("structured")) == default_protocol()
    assert read_protocol_file(Path("visual")) == visual_protocol()
    with pytest.raises(UsageError, match="`visual`, `trees`, `objects` or a file"):
        read_protocol_file(Path("visul"))
