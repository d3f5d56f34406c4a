"""A dataset of drives: no rule on groups applies, the funnel counts none, readers open it, nothing is built of it."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import pytest
from tests.mutation import new_draft

from branchdrive.cli.main import run
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.raw.reader import open_dataset
from branchdrive.release.builder import build_release


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return new_draft("drives").write(tmp_path_factory.mktemp("drives") / "dataset")


def test_rules_on_groups_do_not_apply_and_no_group_is_counted(drives: Path) -> None:
    report = validate(drives)
    assert report.verdict == "valid" and report.is_of_drives
    of_groups = [tally for tally in report.tallies if CATALOGUE[tally.rule_id].scope == "group"]
    assert of_groups
    assert {(tally.status, tally.reason) for tally in of_groups} == {("not-claimed", "drives are in no branch group")}
    assert report.funnel is not None and set(report.funnel.groups.values()) == {0}
    assert report.groups == () and report.num_groups == 0 and report.num_qualified == 0
    examined = {tally.rule_id: tally.examined for tally in report.tallies}
    num_drives = 12
    assert examined["BD-CTL-016"] == num_drives
    assert examined["BD-CTL-009"] == examined["BD-MOT-001"] == examined["BD-EVD-001"] == num_drives + 3


@pytest.mark.parametrize("form", ["text", "markdown"])
def test_a_report_says_that_drives_are_in_no_group(drives: Path, form: str) -> None:
    out = StringIO()
    assert run(["validate", str(drives), "--format", form], out, StringIO()) == 0
    assert out.getvalue().count("drives are in no branch group") >= 2
    assert "Integrity-complete" not in out.getvalue()


def test_readers_open_drives_with_their_decisions(drives: Path) -> None:
    group = next(iter(open_dataset(drives)))
    assert "4 drive" in repr(group) and len(group.drives) == 4
    keys = {drive.rollout_id: drive.column("decisions", "action_key").tolist() for drive in group.drives}
    assert keys["g0.drive-steer_left_0.10.a1"] == ["steer_left_0.10", "steer_right_0.10", "nominal"]
    assert not len(group.nominal.tables["decisions"])


def test_a_drive_that_its_collector_distrusts_breaks_no_claim(tmp_path: Path) -> None:
    draft, drive = new_draft("drives"), "g0.drive-brake_0.50.a1"
    draft.set("controls", "intended_brake", 0.25, rollout_id=drive, tick=110)
    draft.set("rollouts", "status", "quarantined", rollout_id=drive)
    draft.set("rollouts", "status_reason", "another command was sent", rollout_id=drive)
    report = validate(draft.write(tmp_path / "dataset"))
    assert report.verdict == "valid"
    assert {tally.rule_id: tally.examined for tally in report.tallies}["BD-CTL-016"] == 11


def test_nothing_is_built_from_drives(drives: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="holds drives, which are in no branch group") as error:
        build_release(drives, output=tmp_path / "release")
    assert "\n" not in str(error.value)


def test_no_layer_is_claimed_beside_drives(drives: Path) -> None:
    descriptor = read_descriptor(Folder(drives))
    with pytest.raises(ValueError, match="no layer is derived from drives"):
        descriptor.model_validate({**descriptor.model_dump(mode="json"), "layers": ["raw", "canonical"]})
