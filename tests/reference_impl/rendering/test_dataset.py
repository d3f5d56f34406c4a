"""Media for a finished dataset: structured files and identity stay, and an interrupted run is gone on with."""

from __future__ import annotations

import shutil
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest
from tests.reference_impl.rendering.small import SMALL
from tests.sampling import sampled
from tests.synthetic import base_tables, descriptor, with_few_attempts, write_dataset
from tests.synthetic_map import map_descriptor, map_tables

from branchdrive import open_dataset, validate
from branchdrive.cli.main import run
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import ContractError, DatasetError, PlatformError, UsageError
from branchdrive.formats.durable import move
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import build_manifest, write_manifest
from branchdrive.release.publish import is_rendering
from branchdrive.runtime.elsewhere import _Answer
from branchdrive.runtime.executor import isolated
from branchdrive_reference.rendering.dataset import RenderReport, finished_media, render_dataset
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import cameras_of

LARGER = SMALL.model_copy(update={"width_px": 48})
(ABOVE,) = cameras_of(("rgb_top_down",), width_px=16, height_px=16)
PLAN = MediaPlan((SMALL,))
"""Images that are drawn at once."""

_MEDIA = ("media.tar", "frames.parquet")
CONTROLS = "raw/shard-00000/controls.parquet"


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shards with maps, few attempts and no media."""
    root = tmp_path_factory.mktemp("bare") / "dataset"
    write_dataset(root, with_few_attempts(map_tables()), map_descriptor())
    return root


@pytest.fixture(scope="module")
def rendered(bare: Path, tmp_path_factory: pytest.TempPathFactory) -> RenderReport:
    """The same with media."""
    return render_dataset(bare, PLAN, output=tmp_path_factory.mktemp("rendered") / "dataset")


@pytest.fixture
def copy(bare: Path, tmp_path: Path) -> Path:
    """A dataset that a test may change."""
    return Path(shutil.copytree(bare, tmp_path / "dataset"))


def files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_only_media_descriptor_and_manifest_differ(bare: Path, rendered: RenderReport) -> None:
    before, after = files(bare), files(rendered.root)
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    own = {f"raw/shard-0000{index}/{name}" for index in (0, 1) for name in _MEDIA}
    assert changed == {*own, "branchdrive.json", "MANIFEST.sha256"}


def test_the_identity_stays_and_the_dataset_is_valid(bare: Path, rendered: RenderReport) -> None:
    assert f"# dataset {rendered.identity}\n" in (bare / "MANIFEST.sha256").read_text()
    report = validate(rendered.root)
    assert report.verdict == validate(bare).verdict == "valid"
    assert "BD-TAB-007" not in {finding.rule for finding in report.findings}  # images are in the order of attempts


def test_every_observation_of_the_window_has_its_image(rendered: RenderReport) -> None:
    dataset = open_dataset(rendered.root)
    rollout = dataset.group("g0").nominal
    frames = rollout.frames("bev")
    assert [int(tick) - (rollout.branch_tick or 0) for tick in frames.ticks] == list(range(-75, 51, 5))
    assert frames.pixels().shape == (26, 32, 32)
    assert rendered.num_images == sum(table.num_rows for table in dataset.table("frames"))


def test_archives_are_plain_tar_files(rendered: RenderReport) -> None:
    with tarfile.open(rendered.root / "raw/shard-00000/media.tar") as archive:
        member = archive.getmembers()[0]
        assert (member.mtime, member.uid, member.mode) == (0, 0, 0o644)
        assert member.name.endswith(".bev.png")


def test_a_second_run_finds_everything(rendered: RenderReport) -> None:
    before = files(rendered.root)
    again = render_dataset(rendered.root, PLAN)
    assert (again.num_found, again.num_groups, again.identity) == (3, 3, rendered.identity)
    assert files(rendered.root) == before


@pytest.mark.parametrize("after", sampled([1, 3], every=2))
def test_an_interrupted_run_is_gone_on_with(copy: Path, rendered: RenderReport, after: int) -> None:
    def interrupt(num_done: int, _: int) -> None:
        if num_done == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(copy, PLAN, watch=interrupt)
    assert is_rendering(copy)
    found: list[int] = []
    render_dataset(copy, PLAN, watch=lambda num_done, _: found.append(num_done))
    assert found[0] == after
    assert files(copy) == files(rendered.root)


def test_media_of_a_shard_are_final_when_its_groups_are_rendered(copy: Path, rendered: RenderReport) -> None:
    final: list[dict[str, bytes]] = []
    groups: list[int] = []

    def note_shard(places: Mapping[str, str]) -> None:
        final.append({path: (copy / place).read_bytes() for path, place in places.items()})
        groups.append(done[-1])
        assert finished_media(Folder(copy)).items() >= places.items()
        if len(final) == 1:
            raise KeyboardInterrupt

    done: list[int] = []
    for expectation in (pytest.raises(KeyboardInterrupt), nullcontext()):
        with expectation:
            render_dataset(copy, PLAN, watch=lambda num_done, _: done.append(num_done), note_shard=note_shard)
    there = files(rendered.root)
    media = [
        {f"raw/shard-0000{index}/{name}": there[f"raw/shard-0000{index}/{name}"] for name in _MEDIA} for index in (0, 1)
    ]
    assert final == [media[0], media[0], media[1]]
    assert groups[0] < 3
    assert finished_media(Folder(copy)) == {}


def interrupt_installing(root: Path, num_moves: int) -> None:
    """Render, and stop after some files have taken their places."""
    done = iter(range(num_moves))

    def failing(source: Path, target: Path) -> None:
        if next(done, None) is None:
            raise KeyboardInterrupt
        move(source, target)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("branchdrive_reference.rendering.dataset.move", failing)
        render_dataset(root, PLAN)


@pytest.mark.parametrize("num_moves", sampled([2, 0, 4], every=3))
def test_a_run_that_ends_while_it_installs_is_gone_on_with(copy: Path, rendered: RenderReport, num_moves: int) -> None:
    interrupt_installing(copy, num_moves)
    render_dataset(copy, PLAN)
    assert files(copy) == files(rendered.root)


@pytest.mark.parametrize("num_moves", sampled([4, 0], every=2))
def test_other_media_are_not_said_to_be_installed(copy: Path, rendered: RenderReport, num_moves: int) -> None:
    interrupt_installing(copy, num_moves)
    with pytest.raises(UsageError, match="was installing other media"):
        render_dataset(copy, MediaPlan((LARGER,)))
    assert files(copy) == files(rendered.root)


def test_a_plan_is_compared_until_files_take_their_places(
    copy: Path, rendered: RenderReport, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("branchdrive_reference.rendering.dataset._Rendering._install", stop)
    with pytest.raises(KeyboardInterrupt):
        render_dataset(copy, MediaPlan((LARGER,)))
    monkeypatch.undo()
    before = files(copy)
    with pytest.raises(UsageError, match=r"interrupted run has rendered of bev 48x32 .* asked for is bev 32x32 "):
        render_dataset(copy, PLAN)
    assert files(copy) == before
    shutil.rmtree(copy / ".staging")
    render_dataset(copy, PLAN)
    assert files(copy) == files(rendered.root)


def test_all_observations_are_found_done_where_a_camera_drops_an_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy, (*_, shard) = tmp_path / "dataset", with_few_attempts(map_tables()).items()
    write_dataset(copy, dict([shard]), map_descriptor())
    plan = MediaPlan((SMALL, ABOVE), "all")
    monkeypatch.setattr(
        "branchdrive_reference.rendering.group.with_drawn_fault", lambda images, *_: dict(list(images.items())[1:])
    )
    first = render_dataset(copy, plan)
    before = files(copy)
    assert render_dataset(copy, plan).num_images == first.num_images
    assert files(copy) == before


def test_another_plan_leaves_what_an_interrupted_run_rendered(copy: Path, rendered: RenderReport) -> None:
    with pytest.raises(KeyboardInterrupt):
        render_dataset(copy, PLAN, watch=_interrupt)
    with pytest.raises(
        UsageError, match=r"of bev 32x32 \(window branch, .* bev 32x32 \(window all, .* delete the folder"
    ):
        render_dataset(copy, MediaPlan(PLAN.cameras, "all"))
    found: list[int] = []
    render_dataset(copy, PLAN, watch=lambda num_done, _: found.append(num_done))
    assert found[0] == 1
    assert files(copy) == files(rendered.root)


def test_another_plan_starts_over_where_nothing_is_finished(copy: Path, rendered: RenderReport) -> None:
    def interrupt(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(copy, MediaPlan(PLAN.cameras, "all"), watch=interrupt)
    render_dataset(copy, PLAN)
    assert files(copy) == files(rendered.root)


def _interrupt(num_done: int, _: int) -> None:
    if num_done:
        raise KeyboardInterrupt


@pytest.mark.thorough
@pytest.mark.parametrize("how", [{"jobs": 2}, {"executor": isolated(2)}], ids=["processes", "executor"])
def test_worker_processes_change_no_byte(copy: Path, rendered: RenderReport, how: dict[str, Any]) -> None:
    render_dataset(copy, PLAN, **how)
    assert files(copy) == files(rendered.root)


def test_images_that_are_drawn_where_nobody_sees_them_are_told_of(copy: Path) -> None:
    def elsewhere(function: Any, tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        """A machine whose folder has the same name and is another."""
        yield from ((index, _Answer([], task.task)) for index, task in enumerate(tasks))

    with pytest.raises(PlatformError, match=r"media of group '.*' was finished on another machine"):
        render_dataset(copy, PLAN, executor=elsewhere)


@pytest.mark.parametrize("share", [0.5, 1.05])
def test_media_that_do_not_fit_on_the_disk_are_refused(
    copy: Path, rendered: RenderReport, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = int(share * rendered.num_images * (1800 + 0.04 * SMALL.width_px * SMALL.height_px))
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    before = files(copy)
    with pytest.raises(PlatformError, match=r"media need about 0\.0 GB"):
        render_dataset(copy, PLAN)
    assert files(copy) == before


def test_an_archive_that_the_format_does_not_allow_is_refused_before_anything_is_rendered(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = replace(spec_limits(), max_media_bytes=300_000)
    monkeypatch.setattr("branchdrive_reference.rendering.dataset.spec_limits", lambda: small)
    before = files(copy)
    with pytest.raises(ContractError, match="more than 300,000 bytes"):
        render_dataset(copy, PLAN, watch=lambda *_: pytest.fail("it renders"))
    assert files(copy) == before


@pytest.mark.parametrize("after", [None, 3])
def test_changed_files_are_refused_and_nothing_is_touched(copy: Path, after: int | None) -> None:
    path = copy / CONTROLS
    if after is None:
        rewrite(path)
    rendered: list[int] = []

    def watch(num_done: int, _: int) -> None:
        rendered.append(num_done)
        if num_done == after:
            rewrite(path)

    kept = {name: content for name, content in files(copy).items() if copy / name != path}
    with pytest.raises(DatasetError, match="differ"):
        render_dataset(copy, PLAN, watch=watch)
    assert {name: content for name, content in files(copy).items() if copy / name != path} == kept
    assert bool(rendered) == (after is not None)


def rewrite(path: Path) -> None:
    """Other bytes of equal rows."""
    pq.write_table(pq.read_table(path), path, compression="NONE")


def test_a_changed_source_is_not_copied(copy: Path, tmp_path: Path) -> None:
    rewrite(copy / CONTROLS)
    with pytest.raises(DatasetError, match=r"controls\.parquet'\] differ"):
        render_dataset(copy, PLAN, output=tmp_path / "out")
    assert not (tmp_path / "out/MANIFEST.sha256").exists()


def test_no_link_of_the_source_is_followed(copy: Path, tmp_path: Path) -> None:
    elsewhere = (copy / CONTROLS).rename(tmp_path / "elsewhere.parquet")
    (copy / CONTROLS).symlink_to(elsewhere)
    with pytest.raises(DatasetError, match="without following links"):
        render_dataset(copy, PLAN, output=tmp_path / "out")


@pytest.mark.parametrize("is_finished", [True, False])
def test_an_output_with_another_raw_layer_is_refused(copy: Path, rendered: RenderReport, is_finished: bool) -> None:
    rewrite(copy / CONTROLS)
    write_manifest(Folder(copy), build_manifest(Folder(copy)))
    if not is_finished:
        (copy / "MANIFEST.sha256").unlink()
        (copy / ".staging").mkdir()
    before = files(copy)
    with pytest.raises(UsageError, match="has another raw layer"):
        render_dataset(rendered.root, PLAN, output=copy)
    assert files(copy) == before


def test_other_media_are_refused(rendered: RenderReport) -> None:
    with pytest.raises(UsageError, match="has media already: semantic_bev"):
        render_dataset(rendered.root, MediaPlan(cameras_of(("rgb_surround",))))


def test_further_observations_are_other_media(rendered: RenderReport) -> None:
    with pytest.raises(UsageError, match="has media already"):
        render_dataset(rendered.root, MediaPlan(PLAN.cameras, "all"))


def command(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = StringIO(), StringIO()
    return run(["render", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def test_the_command_says_what_it_did(
    bare: Path, rendered: RenderReport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive_reference.rendering.rig.cameras_of", lambda streams, **size: (SMALL,))
    code, out, err = command(bare, "--output", tmp_path / "out", "--streams", "semantic_bev")
    assert (code, err) == (0, "")
    assert out.startswith("routes    ")
    assert "\ngroups    3 rendered, 0 found rendered\nimages    416 in " in out
    assert rendered.identity in out
    assert files(tmp_path / "out") == files(rendered.root)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--streams", "lidar"], "--streams: unknown stream 'lidar'; choose from rgb_surround"),
        (["--streams", ""], "unknown stream"),
        (["--width", "3"], "from 16 to 4096"),
        (["--jobs", "0"], "from 1 to 1024"),
    ],
)
def test_wrong_options_are_refused(bare: Path, options: list[str], message: str) -> None:
    code, out, err = command(bare, *options)
    assert (code, out) == (2, "")
    assert message in err


def test_a_dataset_without_a_map_is_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", base_tables(), descriptor())
    code, _, err = command(tmp_path / "d")
    assert (code, err.count("\n")) == (2, 1)
    assert "claims no stream `map`" in err


@pytest.mark.parametrize("name", ["branchdrive.json", "MANIFEST.sha256"])
def test_an_unfinished_dataset_is_refused(copy: Path, name: str) -> None:
    (copy / name).unlink()
    code, _, err = command(copy)
    assert code == 2
    assert "finished" in err or "no dataset" in err


def test_an_output_with_something_else_is_refused(bare: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    code, _, err = command(bare, "--output", tmp_path)
    assert code == 2
    assert "is not empty and holds no dataset" in err
