"""`branchdrive collect`: datasets are valid and independent of workers, options are checked and explained."""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.bucket_server import serving, use
from tests.places import files_of
from tests.reference_impl.collect.kept_collection import kept_collection
from tests.reference_impl.collect.running import finished_rollouts, start
from tests.sampling import THOROUGH
from tests.waiting import wait_for

from branchdrive import DatasetWriter, open_dataset, validate
from branchdrive.cli.main import run
from branchdrive.collector.report import CollectionReport
from branchdrive_reference.collect.campaign import collect, collection_descriptor
from branchdrive_reference.collect.plan import PRESETS
from branchdrive_reference.scenarios.registry import SCENARIOS

SEED, GROUPS = 3, 2

pytestmark = pytest.mark.usefixtures("remembered_runs")


def branchdrive(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return run([str(argument) for argument in arguments], stdout, stderr), stdout.getvalue(), stderr.getvalue()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    root = kept_collection(tmp_path_factory.mktemp("collected") / "dataset", num_groups=GROUPS, seed=SEED)
    return root, collect(root, num_groups=GROUPS, seed=SEED).identity


def test_a_collected_dataset_is_valid_and_every_group_qualifies(reference: tuple[Path, str]) -> None:
    report = validate(reference[0], require_groups=GROUPS)
    assert report.verdict == "valid"
    assert report.exit_code == 0
    assert report.funnel is not None
    assert report.funnel.qualified == GROUPS


def test_a_collection_is_put_into_a_bucket(
    reference: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serving() as server:
        use(server, monkeypatch)
        options = ("--groups", GROUPS, "--seed", SEED, "--output", "s3://bucket/drives")
        code, out, _ = branchdrive("collect", tmp_path / "out", *options)
        assert code == 0
        assert f"identity  {reference[1]}" in out
        assert "next      branchdrive-validate s3://bucket/drives" in out
        assert {key.removeprefix("drives/"): body for key, body in server.objects.items()} == files_of(reference[0])
    assert branchdrive("collect", tmp_path / "out", *options[:-1], "bucket")[0] == 2


def test_a_finished_dataset_is_left_as_it_is(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, _ = branchdrive("collect", root, "--groups", GROUPS, "--seed", SEED)
    assert code == 0
    assert f"groups    0 collected, {GROUPS} found finished" in out
    assert "ticks " not in out
    assert identity in out


def test_a_finished_dataset_does_not_shrink(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, err = branchdrive("collect", root, "--groups", GROUPS - 1, "--seed", SEED)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"has begun {GROUPS} groups, more than the {GROUPS - 1} asked for; ask for at least {GROUPS}" in err
    assert collect(root, num_groups=GROUPS, seed=SEED).identity == identity


def test_a_finished_dataset_does_not_grow(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, err = branchdrive("collect", root, "--groups", GROUPS + 2, "--seed", SEED)
    assert (code, out) == (2, "")
    assert f"is a finished dataset of {GROUPS} groups, which stays as it is; choose another folder" in err
    assert collect(root, num_groups=GROUPS, seed=SEED).identity == identity


def test_the_summary_reads_well(tmp_path: Path) -> None:
    _, out, _ = branchdrive("collect", tmp_path / "d", "--groups", 1, "--seed", SEED, "--jobs", 4)
    assert re.fullmatch(
        r"disk      about \d MiB needed, [\d,.]+ [GM]iB free\n"
        r"groups    1 collected, 0 found finished\n"
        r"routes    1 route cluster in 1 branched group; a release parts .* takes at least 5: .*\n"
        r"rollouts  15 simulated, 0 found finished\n"
        r"ticks     [\d,]+ in [\d.]+ s with 1 job, writing included: [\d,]+ ticks/s\n"
        r"dataset   \S+\n"
        r"identity  [0-9a-f]{64}\n"
        r"next      branchdrive-validate \S+\n",
        out,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["--groups", 0, "--seed", 1],
        ["--groups", 1, "--seed", -1],
        ["--groups", 1, "--seed", 1, "--jobs", 0],
        ["--groups", 1],
        ["--groups", 1_000_001, "--seed", 1],
        ["--groups", "many", "--seed", 1],
        ["--groups", 1, "--seed", "x"],
        ["--groups", 1, "--seed", 1, "--replay-noise", -0.1],
        ["--groups", 1, "--seed", 1, "--replay-noise", "nan"],
        ["--groups", 1, "--seed", 1, "--replay-noise", 101],
        ["--preset", "huge", "--seed", 1],
        ["--preset", "demo"],
    ],
    ids=[
        "no groups",
        "negative seed",
        "no jobs",
        "no seed",
        "too many groups",
        "no number",
        "no number for a seed",
        "negative noise",
        "no noise",
        "too much noise",
        "unknown preset",
        "preset without seed",
    ],
)
def test_wrong_usage_exits_with_2(tmp_path: Path, arguments: list[object], capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = branchdrive("collect", tmp_path / "d", *arguments)
    captured = capsys.readouterr()
    assert code == 2
    assert not (tmp_path / "d").exists()
    assert not re.search(r"\b_(count|seed|strength)\b", out + err + captured.out + captured.err)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "how many groups? give --groups N or --preset demo|benchmark|context|deep|paper"),
        (["--groups", 1, "--faults", "lost=0.1"], "--faults 'lost=0.1': 'lost' is no fault; give one of none, "),
        (["--groups", 1, "--faults", "partial=2"], "the rate 2 of 'partial' is not in 0 .. 1; give one of none, "),
        (["--groups", 1, "--scenario", "Rain"], f"unknown scenario type 'Rain'; choose from {', '.join(SCENARIOS)}"),
        (
            ["--groups", 1, "--scenario", "highway-cut-in"],
            "'highway-cut-in' (did you mean HighwayCutIn?); choose from ",
        ),
        (["--groups", 1, "--resume"], "holds no collection to resume; leave out --resume to begin one"),
    ],
    ids=["no groups", "unknown fault", "impossible rate", "unknown scenario", "nearly a scenario", "nothing to resume"],
)
def test_wrong_options_are_explained_in_one_line(tmp_path: Path, arguments: list[object], message: str) -> None:
    code, out, err = branchdrive("collect", tmp_path / "d", "--seed", 1, *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert not (tmp_path / "d").exists()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """What the command asks the collector for, instead of a collection."""
    noted: dict[str, object] = {}

    def collect_nothing(root: Path, **options: object) -> CollectionReport:
        noted.update(root=root, **options)
        return CollectionReport((), 0, 1, 1.0, "0" * 64)

    monkeypatch.setattr("branchdrive_reference.collect.campaign.collect", collect_nothing)
    return noted


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_gives_defaults(asked: dict[str, object], name: str) -> None:
    assert branchdrive("collect", "d", "--preset", name, "--seed", 4)[0] == 0
    preset = PRESETS[name]
    assert (asked["num_groups"], asked["replay_noise"], asked["faults"], asked["seed"]) == (
        preset.num_groups,
        preset.replay_noise,
        dict(preset.faults),
        4,
    )


def test_options_override_a_preset(asked: dict[str, object]) -> None:
    options = ["--groups", 5, "--replay-noise", 0, "--faults", "partial=0.5"]
    assert branchdrive("collect", "d", "--preset", "paper", "--seed", 4, *options)[0] == 0
    assert (asked["num_groups"], asked["replay_noise"], asked["faults"]) == (5, 0.0, {"partial": 0.5})
    assert branchdrive("collect", "d", "--preset", "paper", "--seed", 4, "--faults", "none")[0] == 0
    assert (asked["num_groups"], asked["replay_noise"], asked["faults"]) == (2_467, 1.0, {})


def test_without_a_preset_nothing_is_switched_on(asked: dict[str, object]) -> None:
    assert branchdrive("collect", "d", "--groups", 5, "--seed", 4, "--faults", "paper", "--no-media")[0] == 0
    assert asked["faults"] == dict(PRESETS["paper"].faults)
    assert branchdrive("collect", "d", "--groups", 5, "--seed", 4)[0] == 0
    assert (asked["replay_noise"], asked["faults"], asked["scenario_types"]) == (0.0, {}, ())
    assert (asked["jobs"], asked["resume"]) == (1, False)


def test_a_part_is_collected_and_an_interruption_counts_and_repeats_it(
    asked: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ["collect", "d", "--groups", 70, "--part", "3/3", "--seed", 4]
    assert branchdrive(*given)[0] == 0
    assert (asked["num_groups"], asked["part"]) == (70, (3, 3))

    def interrupted(*_: object, watch: Callable[[int, int], None], **__: object) -> CollectionReport:
        watch(4, 0)
        raise KeyboardInterrupt

    monkeypatch.setattr("branchdrive_reference.collect.campaign.collect", interrupted)
    assert branchdrive(*given)[2] == (
        "interrupted; 4 of 6 groups are finished. "
        "To go on, run: branchdrive collect d --groups 70 --part 3/3 --seed 4\n"
    )


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["d", "--groups", 9, "--seed", 4], "d --groups 9 --seed 4"),
        (["a b/it's", "--preset", "demo", "--seed", 4], "'a b/it'\"'\"'s' --preset demo --seed 4"),
        (
            [
                *("d", "--resume", "--no-media", "--seed", 4, "--scenario", "B", "--preset", "paper", "--groups", 9),
                *("--jobs", 2, "--scenario", "A", "--replay-noise", 0.5, "--faults", "partial=0.1,abandoned=1"),
            ],
            "d --groups 9 --preset paper --seed 4 --jobs 2 --replay-noise 0.5 --faults partial=0.1,abandoned=1 "
            "--scenario B --scenario A --no-media --resume",
        ),
    ],
    ids=["few options", "path to be quoted", "all options"],
)
def test_an_interruption_repeats_every_option(
    monkeypatch: pytest.MonkeyPatch, arguments: list[object], command: str
) -> None:
    def interrupted(
        _root: Path, *, num_groups: int, watch: Callable[[int, int], None], **_: object
    ) -> CollectionReport:
        watch(num_groups - 2, 0)
        raise KeyboardInterrupt

    monkeypatch.setattr("branchdrive_reference.collect.campaign.collect", interrupted)
    code, out, err = branchdrive("collect", *arguments)
    num_groups = 9 if "--groups" in arguments else PRESETS["demo"].num_groups
    progress = f"{num_groups - 2} of {num_groups} groups are finished"
    assert (code, out) == (130, "")
    assert err == f"interrupted; {progress}. To go on, run: branchdrive collect {command}\n"


def test_a_finished_collection_can_be_resumed(reference: tuple[Path, str]) -> None:
    root, identity = reference
    code, out, _ = branchdrive("collect", root, "--groups", GROUPS, "--seed", SEED, "--resume", "--no-media")
    assert code == 0
    assert f"groups    0 collected, {GROUPS} found finished" in out
    assert identity in out


@pytest.mark.parametrize("options", [["--faults", "partial=0.5"], ["--replay-noise", 1], ["--seed", SEED + 1]])
def test_another_collection_is_not_resumed(reference: tuple[Path, str], options: list[object]) -> None:
    code, out, err = branchdrive("collect", reference[0], "--groups", GROUPS, "--seed", SEED, *options, "--resume")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "holds a dataset with another descriptor" in err


def test_a_selection_of_scenarios_is_part_of_the_dataset(tmp_path: Path) -> None:
    root = tmp_path / "d"
    first, second, *_ = SCENARIOS
    given = ["--groups", 1, "--seed", SEED, "--scenario"]
    assert branchdrive("collect", root, *given, second)[0] == 0
    dataset = open_dataset(root)
    assert dataset.descriptor.collection.scenario_types == (second,)
    assert {row["scenario_type"] for row in dataset.rollouts().to_pylist()} == {second}
    assert validate(root).verdict == "valid"
    code, _, err = branchdrive("collect", root, *given, first, "--scenario", second)
    assert code == 2
    assert f"collection.scenario_types is ['{second}'], not ['{first}', '{second}']" in err
    assert branchdrive("collect", root, *given, second, "--scenario", second, "--resume")[0] == 0


def test_a_full_disk_is_found_out_before_anything_is_created(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=2**20))
    code, out, err = branchdrive("collect", tmp_path / "d", "--preset", "paper", "--seed", SEED)
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert re.search(r"2,467 groups do not fit on this disk: about [\d.]+ GiB needed, 1 MiB free; make room", err)
    assert not (tmp_path / "d").exists()


def test_a_disk_that_has_filled_up_stops_a_resumed_collection(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "d"
    DatasetWriter(root, collection_descriptor(SEED)).close()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
    code, out, err = branchdrive("collect", root, "--groups", 2, "--seed", SEED)
    assert (code, out) == (4, "")
    assert "2 groups do not fit on this disk" in err


FAULTY_SEED, FAULTY_GROUPS = 17, 2
"""Of a collection with failures, a lost frame, and one group of two that is abandoned."""

FAULTS = {"partial": 0.05, "quarantined": 0.05, "abandoned": 0.3, "duplicate": 0.1, "dropped_frame": 0.1}


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory, remembered_runs: None) -> tuple[Path, CollectionReport]:
    root = tmp_path_factory.mktemp("faulty") / "dataset"
    return root, collect(root, num_groups=FAULTY_GROUPS, seed=FAULTY_SEED, faults=FAULTS, replay_noise=1.0)


def test_faults_are_declared_and_leave_a_valid_dataset(faulty: tuple[Path, CollectionReport]) -> None:
    root, report = faulty
    assert open_dataset(root).descriptor.collection.faults == FAULTS
    assert validate(root).verdict == "valid"
    assert any(group.stopped_because for group in report.groups)


@THOROUGH
def test_faults_and_noise_do_not_depend_on_workers_or_interruptions(
    tmp_path: Path, faulty: tuple[Path, CollectionReport]
) -> None:
    root = tmp_path / "d"
    spec = ",".join(f"{name}={rate}" for name, rate in FAULTS.items())
    declared = ["--faults", spec, "--replay-noise", 1]
    options = ["--groups", FAULTY_GROUPS, "--seed", FAULTY_SEED, "--jobs", 2, *declared]
    process = start(root, seed=FAULTY_SEED, jobs=1, groups=FAULTY_GROUPS, options=declared)
    wait_for(lambda: finished_rollouts(root) >= 3)
    process.kill()
    process.communicate()
    code, out, _ = branchdrive("collect", root, *options, "--resume")
    assert code == 0
    assert faulty[1].identity in out
    num_stopped = sum(bool(group.stopped_because) for group in faulty[1].groups)
    assert f"          {num_stopped} stopped early by injected faults\n" in out


def test_a_folder_of_another_dataset_is_refused(reference: tuple[Path, str]) -> None:
    code, out, err = branchdrive("collect", reference[0], "--groups", 1, "--seed", SEED + 1)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert f"another descriptor (dataset_id is 'branchdrive-reference-s{SEED}', not " in err
    assert f"collection.seed is {SEED}, not {SEED + 1}" in err
