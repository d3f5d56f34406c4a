"""`branchdrive study` at its edges: what it prints, where it writes, and how it refuses."""

from __future__ import annotations

import argparse
import io
import json
from pathlib import Path

import pytest
from tests.mutation import new_draft
from tests.reference_impl.study import samples
from tests.synthetic import bare_descriptor, group_name

from branchdrive.driving.discrepancy import CORE, EXTENDED
from branchdrive.errors import UsageError
from branchdrive.text.table import Passage, Table
from branchdrive.text.terminal import PLAIN_WIDTH
from branchdrive_reference.study import command
from branchdrive_reference.study.survey import study_dataset
from branchdrive_reference.study.text import study_sections

Result = tuple[int, str, str]


def study(*arguments: object) -> Result:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    stdout, stderr = io.StringIO(), io.StringIO()
    code = command.run(parser.parse_args([str(argument) for argument in arguments]), stdout, stderr)
    return code, stdout.getvalue(), stderr.getvalue()


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return samples.written(tmp_path_factory.mktemp("study") / "dataset")


def test_text_has_every_table_and_fits_its_width(root: Path) -> None:
    code, out, err = study(root, "--full")
    assert (code, err) == (0, "")
    for title in (
        "Population",
        "Nominal drives",
        "Drives with a collision",
        "Family of the best",
        "Family of the worst",
    ):
        assert title in out
    assert "branch groups   3, 3 integrity-complete\n" in out
    assert "36 interventions" in out
    assert "6 nominal replays" in out
    assert "6 of 6 compared nominal replays differ from their nominals: controls 6, observations 6" in out
    lines = out.splitlines()
    assert max(map(len, lines)) <= PLAIN_WIDTH
    assert all(line == line.rstrip() for line in lines)
    assert "\x1b" not in out
    tables = [line.split()[0] for line in lines if line.startswith(("CutIn", "all"))]
    assert tables == ["CutIn", "all"] * 5


@pytest.mark.parametrize("options", [(), ("--full",)], ids=["headlines", "full"])
def test_drives_are_told_as_what_they_are(options: tuple[str, ...], tmp_path: Path) -> None:
    root = new_draft("drives").write(tmp_path / "dataset")
    code, out, err = study(root, *options)
    assert (code, err) == (0, "")
    assert "branch groups" not in out and "integrity-complete" not in out
    facts = {line[:16].strip(): line[16:] for line in out.splitlines()}
    assert (facts["contexts"], facts["drives"]) == ("3", "12")
    assert facts["decisions"].startswith("21: nominal 6, ")
    assert "Drives are in no branch group: there is no bank to rank and no replay to compare." in out
    (held, outcomes) = study_sections(study_dataset(root, lambda *_: None))
    assert isinstance(held, Table) and held.rows[:2] == [["contexts", "3"], ["drives", "12"]]
    assert isinstance(outcomes, Passage)


def test_headlines_fit_on_a_screen_and_say_where_the_rest_is(root: Path) -> None:
    code, out, err = study(root)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert len(lines) <= 36 < len(study(root, "--full")[1].splitlines())
    assert max(map(len, lines)) <= PLAIN_WIDTH
    assert "Outcomes of 3 integrity-complete groups, % of each family" in lines
    assert sum(line.startswith(("collides ", "has the ")) for line in lines) == 4
    assert [line.split()[1] for line in lines if line.startswith(("36 ", "6 "))][:2] == ["interventions", "nominal"]
    assert lines[-1] == "--full has every scenario type and variable, --format json every number."


def test_json_holds_the_numbers_of_the_text(root: Path) -> None:
    code, out, _ = study(root, "--format", "json")
    document = json.loads(out)
    assert code == 0
    assert document["population"]["num_groups"] == 3
    assert document["scenarios"][0]["scenario_type"] == "CutIn"
    assert document["overall"]["scenario_type"] == "all"
    assert len(document["interventions"]) == len(document["nominal_replays"]) == len((*CORE, *EXTENDED))
    assert document["equality"]["num_compared"] == 6
    assert document["population"]["num_integrity_complete"] == 3
    assert 0 <= document["overall"]["best_collided_in_window"] <= document["overall"]["best_collided"] <= 1


@pytest.mark.parametrize("form", ["text", "json"])
def test_a_file_holds_what_would_have_been_printed(tmp_path: Path, root: Path, form: str) -> None:
    _, printed, _ = study(root, "--format", form)
    assert study(root, "--format", form, "--output", tmp_path / "out") == (0, "", "")
    assert (tmp_path / "out").read_text("utf-8") == printed
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_skipped_groups_are_named_as_such(tmp_path: Path) -> None:
    nominal = f"{group_name(0)}.nominal.a1"
    samples.written(tmp_path / "d", {"rollouts": samples.replaced("status", {nominal: "partial"})})
    _, out, _ = study(tmp_path / "d")
    out = " ".join(out.split())
    assert "3, 2 integrity-complete; left out of outcomes, ranks and discrepancies is 1 that lacks a complete" in out
    assert "4 compared nominal replays differ" in out
    assert "They are of all groups, also of those that are not integrity-complete." in out
    assert "2 more lack a complete nominal or are not complete." in out


def test_without_evidence_the_text_says_what_is_unknown(tmp_path: Path) -> None:
    samples.written(tmp_path / "d", document=bare_descriptor())
    _, out, _ = study(tmp_path / "d")
    assert "Collisions and ranks are unknown: the dataset claims no risk evidence" in out
    assert "Family of" not in out


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("nowhere", "holds no finished dataset: there is no 'branchdrive.json'"),
        ("", "holds no finished dataset: there is no 'branchdrive.json'"),
        ("dataset/raw", "holds no finished dataset: there is no 'branchdrive.json'"),
        ("dataset/branchdrive.json", "holds no finished dataset: there is no 'branchdrive.json'"),
        ("unsealed", "holds no finished dataset: there is no 'MANIFEST.sha256'"),
        ("no descriptor", "is not a descriptor"),
        ("empty", "holds no branch group"),
        ("damaged", "does not decode"),
    ],
)
def test_a_wrong_folder_is_one_clear_line(tmp_path: Path, place: str, message: str) -> None:
    for name in ("dataset", "unsealed", "no descriptor", "empty", "damaged"):
        samples.written(tmp_path / name)
    (tmp_path / "no descriptor" / "branchdrive.json").write_text("{}")
    (tmp_path / "unsealed" / "MANIFEST.sha256").unlink()
    for path in sorted((tmp_path / "empty" / "raw").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    (tmp_path / "damaged" / samples.FIRST / "controls.parquet").write_bytes(b"PAR1")
    with pytest.raises(UsageError, match=message) as caught:
        study(tmp_path / place)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("target", "told"), [("", "is a folder; name a file"), ("nowhere/out", "does not exist")])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_read(
    tmp_path: Path, target: str, told: str
) -> None:
    with pytest.raises(UsageError, match=rf"--output: .*{told}"):
        study(tmp_path / "no dataset", "--output", tmp_path / target)


def test_an_output_inside_the_dataset_is_refused(root: Path) -> None:
    with pytest.raises(UsageError, match="lies inside the dataset"):
        study(root, "--output", root / "raw" / "study.txt")
    assert not (root / "raw" / "study.txt").exists()
