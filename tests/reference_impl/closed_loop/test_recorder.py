"""Drives as a raw dataset of the reference world: valid, and their first windows those of recorded candidates."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest

from branchdrive.contract.bank import load_action_bank
from branchdrive.engine.validate import validate
from branchdrive.raw.group import BranchGroup
from branchdrive.raw.reader import open_dataset
from branchdrive.writer.writer import DatasetWriter
from branchdrive_reference.closed_loop.arm import CONDITIONS, Arm, Condition
from branchdrive_reference.closed_loop.course import Course, Schedule
from branchdrive_reference.closed_loop.recorder import Recorder, drives_descriptor
from branchdrive_reference.closed_loop.reference_field import ReferenceField
from branchdrive_reference.closed_loop.sight import SensorNoise
from branchdrive_reference.closed_loop.site import Nominal
from branchdrive_reference.collect.campaign import collect, collection_descriptor

SEED, TYPES = 900, ("HardBrakeRoute",)
BANK = load_action_bank()
CHOSEN = ("steer_left_0.10", "brake_0.50", "accelerate_0.50")
EXACT = Condition(CONDITIONS[0])
TABLES = ("controls", "observations", "actors", "evidence")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BranchGroup]:
    """Drives in the group of a collection, with one decision and with three, and that group."""
    folder = tmp_path_factory.mktemp("recorded")
    collect(folder / "collected", num_groups=1, seed=SEED, scenario_types=TYPES)
    field = ReferenceField(TYPES, {})
    descriptor = drives_descriptor(collection_descriptor(SEED, scenario_types=TYPES), field, SEED, [EXACT])
    place, _ = field.place(SEED, 0)
    site = field.site(SEED, 0)
    nominal = site.nominal()
    assert isinstance(nominal, Nominal)
    drives = []
    for schedule in (Schedule(50, 1), Schedule(30, 3)):
        course = Course(site, nominal, BANK, schedule)
        for key in CHOSEN:
            chosen = BANK.keys.index(key)
            drives.append((Arm(key, schedule, EXACT), course.drive(lambda _, i=chosen: i, SensorNoise(0.0, 1))))
    with DatasetWriter(folder / "drives", descriptor, maps=field.maps) as writer:
        recorder = Recorder(folder / "drives", descriptor, {place.group_id: 0})
        recorder.write(place, nominal, drives)
        writer.finalize()
    return folder / "drives", next(iter(open_dataset(folder / "collected")))


def test_drives_are_a_valid_dataset(recorded: tuple[Path, BranchGroup]) -> None:
    report = validate(recorded[0])
    assert report.verdict == "valid", [finding.message for finding in report.findings]
    assert [tally.rule_id for tally in report.tallies if tally.status == "fail"] == []
    examined = {tally.rule_id: tally.examined for tally in report.tallies}
    assert examined["BD-CTL-016"] == 2 * len(CHOSEN) and examined["BD-KEY-009"] > 0


def rows(table: pa.Table, until: int) -> pa.Table:
    kept = table.filter(pc.less_equal(table["tick"], until))
    return kept.drop_columns(["rollout_id"])


@pytest.mark.parametrize("key", CHOSEN)
def test_first_windows_are_those_of_recorded_candidates(recorded: tuple[Path, BranchGroup], key: str) -> None:
    group = next(iter(open_dataset(recorded[0])))
    candidate = recorded[1].candidates[key]
    of_key = {d.record["protocol_variant"]: d for d in group.drives if d.record["action_key"] == key}
    branch_tick = candidate.record["branch_tick"]
    for variant, end in (("every-50-decisions-1", 10**6), ("every-30-decisions-3", branch_tick + 29)):
        drive = of_key[variant]
        for name in TABLES:
            assert rows(drive.tables[name], end).equals(rows(candidate.tables[name], end)), (variant, name)
    assert of_key["every-30-decisions-3"].column("decisions", "tick").tolist() == [
        branch_tick, branch_tick + 30, branch_tick + 60
    ]  # fmt: skip


def test_the_nominal_pass_is_the_recorded_one(recorded: tuple[Path, BranchGroup]) -> None:
    nominal = next(iter(open_dataset(recorded[0]))).nominal
    for name in TABLES:
        assert rows(nominal.tables[name], 10**6).equals(rows(recorded[1].nominal.tables[name], 10**6)), name
    own = ("rollout_id", "trigger_rollout_id", "protocol_variant", "provenance", "repetition", "simulator_version")
    fields = [{k: v for k, v in r.record.items() if k not in own} for r in (nominal, recorded[1].nominal)]
    assert fields[0] == fields[1]
