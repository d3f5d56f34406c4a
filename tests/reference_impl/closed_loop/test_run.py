"""A whole run in a tiny world: locked first, on record, the same after a kill, and clear about hostile answers."""

from __future__ import annotations

import argparse
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.content_cache import kept_folder
from tests.reference_impl.benchmark.small_release import make_release
from tests.reference_impl.closed_loop.roads import KNOWN_ROADS, Roads
from tests.repo.checkout import ROOT

from branchdrive.collector.world import Scene
from branchdrive.contract.bank import load_action_bank
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.durable import partial_path
from branchdrive_reference.closed_loop import command
from branchdrive_reference.closed_loop.arm import CONDITIONS, Condition
from branchdrive_reference.closed_loop.course import Course, Schedule
from branchdrive_reference.closed_loop.external import External
from branchdrive_reference.closed_loop.lock import LOCK_NAME
from branchdrive_reference.closed_loop.plan import make_plan
from branchdrive_reference.closed_loop.recorder import DRIVES_DIR
from branchdrive_reference.closed_loop.run import Request, drive_release
from branchdrive_reference.closed_loop.sight import SensorNoise, Sight
from branchdrive_reference.closed_loop.site import Nominal, Route
from branchdrive_reference.closed_loop.table import CONCLUSIONS

BANK = load_action_bank()
BRAKES = (
    "import json, sys; asked = json.load(sys.stdin); assert len(asked['state']['speed_mps']) == 16; print('brake_0.50')"
)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kept_folder("bare-release", make_release, tmp_path_factory.mktemp("bare") / "release")


@pytest.fixture
def request_(bare: Path, tmp_path: Path) -> Request:
    return Request(
        release=shutil.copytree(bare, tmp_path / "release"),
        output=tmp_path / "drives",
        selectors=("type_prior", "brake_0.50", "oracle"),
        profile="near_range",
        num_groups=3,
        seed=5,
        schedules=(Schedule(50, 1), Schedule(50, 2)),
        conditions=(Condition(CONDITIONS[0]), Condition(CONDITIONS[2], sensor=1.0)),
        looks_ahead=True,
        is_recorded=True,
    )


def drive(request: Request, **options: Any) -> dict[str, Any]:
    return drive_release(request, field=Roads.make(), **options).results


KILLED = """
import os, pickle, signal, sys
from branchdrive_reference.closed_loop.run import drive_release
from tests.reference_impl.closed_loop.roads import Roads

def kill_after_one(done, total):
    if done == 1:
        os.kill(os.getpid(), signal.SIGKILL)

drive_release(pickle.load(sys.stdin.buffer), field=Roads.make(), watch=kill_after_one)
"""
"""A process that is gone once a group is driven."""


def killed(request: Request) -> int:
    """Status of a process that drives until it is killed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, "-c", KILLED], input=pickle.dumps(request), env=environment).returncode


def groups_of(request: Request) -> list[dict[str, Any]]:
    """What was written of each group."""
    return [json.loads(path.read_bytes()) for path in sorted((request.output / "groups").iterdir())]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_run_is_locked_recorded_and_the_same_after_a_kill(request_: Request, tmp_path: Path) -> None:
    whole = replace(request_, output=tmp_path / "whole")
    results = drive(whole)
    lock = json.loads((whole.output / LOCK_NAME).read_bytes())
    roads = {group["route_id"] for group in lock["plan"]["groups"]}
    assert len(roads) and not roads & {f"road-{road}" for road in KNOWN_ROADS}
    assert [arm["selector"] for arm in results["arms"][:4]] == ["nominal", "type_prior", "brake_0.50", "oracle"]
    assert len(results["arms"]) == 4 * 2 * 2 and results["num_driven"] == 3 and not results["warnings"]
    by_arm = {(arm["selector"], arm["num_decisions"], arm["condition"]): arm for arm in results["arms"]}
    assert by_arm["brake_0.50", 2, "exact"]["later_choices"] == {"brake_0.50": 3}
    assert by_arm["brake_0.50", 1, "exact"]["later_choices"] == {}
    offline = {one["selector"]: one for one in results["offline"]["selectors"]}
    assert offline["oracle"]["regret"]["value"] == 0 and offline["nominal"]["value"]["value"] > 0
    ahead = by_arm["oracle", 2, "exact"]["look_ahead"]
    assert (ahead["first"]["value"], ahead["first"]["num_ranked"]) == (0, 3)
    assert [one["value"] for one in ahead["by_decision"] if one["num_ranked"]].count(0) >= 1
    assert by_arm["type_prior", 2, "exact"]["look_ahead"]["first"]["value"] == pytest.approx(
        offline["type_prior"]["regret"]["value"]
    )
    tables = (whole.output / "TABLES.md").read_text(encoding="utf-8")
    assert tables.startswith(f"# Closed loop\n\n## What may and may not be concluded\n\n{CONCLUSIONS}\n")

    request_.output.mkdir()
    partial_path(request_.output / LOCK_NAME).write_bytes(b"{")  # what an earlier kill leaves
    assert killed(request_) == -signal.SIGKILL
    (first,) = (request_.output / "groups").iterdir()
    written = first.stat().st_mtime_ns
    drive(request_)
    assert first.stat().st_mtime_ns == written and contents(request_.output) == contents(whole.output)

    report = validate(whole.output / DRIVES_DIR)
    assert report.verdict == "valid"
    examined = {tally.rule_id: tally.examined for tally in report.tallies}
    driven = {(one["group_id"], d["num_decisions"], *d["choices"]) for one in groups_of(whole) for d in one["drives"]}
    assert examined["BD-CTL-016"] == len(driven) and examined["BD-CTL-009"] == len(driven) + 3

    with pytest.raises(UsageError, match="another lock"):
        drive(replace(request_, seed=6))
    again = drive(
        replace(request_, output=tmp_path / "again", selectors=("brake_0.30",), conditions=whole.conditions[:1])
    )
    assert "driven under 2 locks" in again["warnings"][0]
    entries = json.loads((tmp_path / "release.drives.json").read_bytes())["entries"]
    assert [entry["number"] for entry in entries] == [1, 2]
    assert len({entry["plan_digest"] for entry in entries}) == 1


def test_a_run_without_a_record_is_driven_again_for_one(request_: Request, tmp_path: Path) -> None:
    short = replace(request_, selectors=("brake_0.50",), schedules=(Schedule(50, 2),), num_groups=1)
    recorded, late = replace(short, output=tmp_path / "recorded"), replace(short, output=tmp_path / "late")
    assert drive(replace(late, is_recorded=False)) == drive(recorded)
    assert not (late.output / DRIVES_DIR).exists()
    drive(late)
    assert contents(late.output) == contents(recorded.output)
    stamps = {path: path.stat().st_mtime_ns for path in (late.output / DRIVES_DIR).rglob("*")}
    drive(late)  # of what is finished, nothing is written again
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps


def test_a_command_asks_for_a_record() -> None:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    words = ["release", "--output", "drives", "--selector", "nominal", "--groups", "1", "--seed", "2"]
    asked = [command.request_of(parser.parse_args([*words, *more])).is_recorded for more in ([], ["--record"])]
    assert asked == [False, True]


@pytest.mark.parametrize("name", ["nobody", "E-M9", "a=", "=x", "oracle=true", "E-M3=true", "brake_0.50=true"])
def test_a_selector_that_is_none_is_one_clear_error(request_: Request, name: str) -> None:
    with pytest.raises(UsageError):
        drive(replace(request_, selectors=(name,)))
    assert not (request_.output / LOCK_NAME).exists()


def test_a_world_is_reset_once_for_every_place_of_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    field, seeds = Roads.make(), list[int]()
    world = field.collector.world("ParkedObstacle")
    reset = world.reset

    def counted(seed: int) -> Scene:
        seeds.append(seed)
        return reset(seed)

    monkeypatch.setattr(world, "reset", counted)
    plan = make_plan(field, 1, 3, [Route("elsewhere", np.zeros((32, 2)))])
    assert seeds == [place.seed for place in plan.places]


def test_groups_of_the_release_are_not_driven(request_: Request) -> None:
    seed = json.loads((request_.release / "branchdrive.json").read_bytes())["collection"]["seed"]
    with pytest.raises(UsageError, match="is the seed of the release"):
        drive(replace(request_, seed=seed))
    assert not request_.output.exists()


@pytest.fixture(scope="module")
def sight() -> Sight:
    site = Roads.make().site(5, 0)
    nominal = site.nominal()
    assert isinstance(nominal, Nominal)
    seen: list[Sight] = []
    Course(site, nominal, BANK, Schedule(50, 1)).drive(lambda one: len(seen.append(one) or ""), SensorNoise(0.0, 1))
    return seen[0]


def test_a_program_of_others_answers_with_a_candidate(sight: Sight) -> None:
    selector = External("mine", (sys.executable, "-c", BRAKES), BANK.keys)
    assert selector(sight) == BANK.keys.index("brake_0.50")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("sh", "-c", "echo full_speed"), "answered 'full_speed"),
        (("sh", "-c", "printf '\\377\\376'"), "expected one of the candidates"),
        (("true",), "expected one of the candidates"),
        (("sh", "-c", "echo nominal; echo nominal"), "expected one of the candidates"),
        (("sh", "-c", "echo nominal; exit 3"), "ended with status 3"),
        (("no-such-program-of-anyone",), "cannot be started"),
        (("yes",), "more than 4096 bytes"),
        (("sleep", "60"), "no answer within 0.2 s"),
        (("sh", "-c", "sleep 60 & wait"), "no answer within 0.2 s"),
    ],
)  # fmt: skip
def test_a_hostile_answer_is_one_clear_error(sight: Sight, command: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        External("mine", command, BANK.keys, patience_s=0.2 if "no answer" in message else 30.0)(sight)
