"""A protocol that somebody else wrote names no file outside of the release, and is refused before anything is done."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.reference_impl.benchmark.small_release import contents, invoke, protocol

from branchdrive import DatasetError, UsageError
from branchdrive.benchmark.tables import render_tables
from branchdrive.contract.document import dump_json
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive_reference.benchmark.command.evaluate import render_results

NAME = "../../x/pwn"


def of_m3(change: Callable[[Any], object]) -> dict[str, Any]:
    document = protocol()
    change(document["models"][3])
    return document


def of_training(name: str, value: Any) -> dict[str, Any]:
    return of_m3(lambda model: model["configuration"]["training"].update({name: value}))


HOSTILE = {
    "name leads out": (
        of_m3(lambda model: model["configuration"]["model"].update(name=NAME)), "has the name '../../x/pwn', not 'M3'"
    ),
    "name is hidden": (
        of_m3(lambda model: model["configuration"]["model"].update(name=".M3")), "has the name '.M3', not 'M3'"
    ),
    "contract is another": (
        of_m3(lambda model: model["configuration"]["model"].update(contract="privileged")),
        "has the contract 'privileged', not 'sensor'",
    ),
    "title has lines": (of_m3(lambda model: model.update(title="Best\n## Injected")), "/models/3/title"),
}  # fmt: skip
UNTRAINABLE = {
    "no epoch": (of_training("max_epochs", 0), "/training/max_epochs"),
    "no batch": (of_training("batch_groups", 0), "/training/batch_groups"),
    "huge": (of_m3(lambda model: model["configuration"]["model"].update(fusion_width=2**40)), "/model/fusion_width"),
    "other software": (of_m3(lambda model: model.update(configuration={"layers": 3})), "/model: Field required"),
}  # fmt: skip
ALL = HOSTILE | UNTRAINABLE


def publish(release: Path, document: dict[str, Any]) -> None:
    """Let the protocol be the one that the release brings."""
    (release / "benchmark").mkdir()
    (release / "benchmark" / "protocol.json").write_bytes(dump_json(document))
    write_manifest(Folder(release), build_manifest(Folder(release)))


@pytest.mark.parametrize(("document", "words"), ALL.values(), ids=list(ALL))
def test_a_release_that_brings_it_is_not_trained(release: Path, document: dict[str, Any], words: str) -> None:
    publish(release, document)
    before = contents(release.parent)
    with pytest.raises(DatasetError) as error:
        invoke("train", release, "--no-guard")
    assert words in str(error.value)
    assert str(error.value).isprintable()
    assert contents(release.parent) == before


@pytest.mark.parametrize(("document", "words"), ALL.values(), ids=list(ALL))
@pytest.mark.parametrize("command", ["train", "benchmark", "lock"])
def test_a_file_that_holds_it_is_refused_and_does_not_wait(
    release: Path, tmp_path: Path, command: str, document: dict[str, Any], words: str
) -> None:
    file = tmp_path / "protocol.json"
    file.write_text(json.dumps(document))
    before = contents(tmp_path)
    with pytest.raises(UsageError) as error:
        invoke(command, release, "--protocol", file)
    assert str(error.value).startswith(f"{file}: ")
    assert words in str(error.value)
    assert contents(tmp_path) == before


def test_nothing_is_dropped_outside_of_the_release(release: Path) -> None:
    publish(release, HOSTILE["name leads out"][0])
    victim = release.parent / "x" / "pwn-seed11.safetensors"
    victim.parent.mkdir()
    victim.write_bytes(b"theirs")
    with pytest.raises(DatasetError, match="has the name"):
        invoke("train", release, "--no-guard")
    assert victim.read_bytes() == b"theirs"


def test_a_checkpoint_in_a_folder_of_its_own_is_not_taken_along(benchmarked: Path) -> None:
    folder = benchmarked / "benchmark" / "checkpoints" / "deep"
    folder.mkdir()
    (folder / "M1-seed11.safetensors").write_bytes(b"theirs")
    write_manifest(Folder(benchmarked), build_manifest(Folder(benchmarked)))
    before = contents(benchmarked)
    invoke("train", benchmarked)
    assert contents(benchmarked) == before


def test_results_of_others_write_no_cell_no_tag_and_no_control_character(done: Path) -> None:
    results = json.loads((done / "benchmark" / "results.json").read_bytes())
    results["models"][3]["title"] = "Best | 0.000 <script>"
    results["warnings"] = ["Nothing | to <b>see</b>."]
    text = render_tables(results)
    assert "M3 Best \\| 0.000 &lt;script>" in text
    assert "> **Warning.** Nothing \\| to &lt;b>see&lt;/b>." in text
    assert "<script>" not in text
    results["models"][3]["title"] = results["warnings"][0] = results["guard"]["reason"] = "\x1b[2J\nInjected"
    shown = render_results(results, io.StringIO())
    assert "\x1b" not in shown
    assert "\nInjected" not in shown
