"""`branchdrive show`: a sheet and an animation of a group, and one line for wrong usage."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.synthetic import write_dataset
from tests.synthetic_map import map_descriptor, map_tables

from branchdrive import open_dataset
from branchdrive.cli.main import run
from branchdrive.contract.semantic_bev import SemanticChannel, SemanticClass
from branchdrive_reference.drawing.palette import BACKDROP
from branchdrive_reference.rendering.dataset import render_dataset
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import MEDIA_STREAMS, cameras_of
from branchdrive_reference.showing.chart import coloured, ink
from branchdrive_reference.showing.sheet import Sheet, animated_bytes, outcome_inks, read_sheet


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One shard with small images of every stream."""
    root = tmp_path_factory.mktemp("shown") / "dataset"
    (*_, last) = map_tables().items()
    write_dataset(root, dict([last]), map_descriptor())
    render_dataset(root, MediaPlan(cameras_of(MEDIA_STREAMS, width_px=32, height_px=18)))
    return root


def show(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = StringIO(), StringIO()
    return run(["show", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def test_a_sheet_is_written_once_and_again(root: Path, tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    for path in paths:
        assert show(root, "g2", "--output", path) == (0, f"{path}\n", "")
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with Image.open(paths[0]) as sheet:
        assert sheet.mode == "RGB"
        assert min(sheet.size) > 600


def test_an_animation_has_a_picture_for_each_observation(root: Path) -> None:
    sheet = read_sheet(open_dataset(root), "g2")
    assert sheet.ticks == tuple(range(-75, 51, 5))
    sheet.__dict__["ticks"] = (-75, 0, 50)  # the first, the branch and the last are enough
    heard: list[tuple[int, int]] = []
    with Image.open(BytesIO(animated_bytes(sheet, lambda done, total: heard.append((done, total))))) as animation:
        assert (animation.n_frames, heard[-1]) == (3, (3, 3))


def test_an_animation_is_announced_where_no_bar_is_seen(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive_reference.showing.sheet.animated_bytes", lambda sheet, show: b"GIF89a")
    output = tmp_path / "a.gif"
    assert show(root, "g2", "--output", output) == (0, f"{output}\n", "drawing 26 frames\n")
    assert output.read_bytes() == b"GIF89a"


def test_the_futures_lie_on_the_chart(root: Path) -> None:
    sheet = read_sheet(open_dataset(root), "g2")
    whole, begun = (np.asarray(sheet.picture(tick)).astype(int) for tick in (0, 5))
    assert (whole != begun).any()


def without(sheet: Sheet, *streams: str, **scene: Any) -> Sheet:
    """The sheet of a dataset without the cameras of some streams."""
    cameras = tuple(one for one in sheet.descriptor.cameras if one.stream not in streams)
    descriptor = sheet.descriptor.model_copy(update={"cameras": cameras})
    return Sheet(replace(sheet.scene, **scene), sheet.nominal, descriptor)


def chart_pixels(sheet: Sheet, tick: int = 0) -> np.ndarray:
    return np.asarray(sheet.picture(tick))[-576:-16, 16:576].astype(int)


def test_a_chart_without_a_semantic_view_shows_what_is_recorded(root: Path) -> None:
    sheet = read_sheet(open_dataset(root), "g2")
    whole, bare = (
        chart_pixels(without(sheet, "semantic_bev")),
        chart_pixels(without(sheet, "semantic_bev", elements=())),
    )
    inner = np.s_[12:-12, 12:-12]  # the frame of the view aside
    assert (np.abs(whole - chart_pixels(sheet)).max(axis=2)[inner] > 40).mean() < 0.02
    ego = np.s_[372:388, 278:282]
    assert (bare[ego].max(axis=2) < 60).mean() > 0.4
    assert (np.abs(whole - bare).max(axis=2) > 20).mean() > 0.02


def test_the_world_goes_on_where_the_semantic_view_ends(root: Path) -> None:
    sheet = read_sheet(open_dataset(root), "g2")
    chart, expected = sheet._chart, chart_pixels(sheet)
    small = np.zeros((40, 40), np.uint8)
    camera = sheet._bev.model_copy(update={"origin_row_px": 20.0, "origin_column_px": 20.0})  # type: ignore[union-attr]
    cut = np.asarray(replace(chart, camera=camera).picture(0, small)).astype(int)
    changed = np.abs(cut - expected).max(axis=2) > 40
    reach = 20 / 2 / chart.side_m * 560 + 4
    rows, columns = np.nonzero(changed[12:-12, 12:-12])
    assert changed.any()
    assert np.abs(rows + 12 - 0.68 * 560).max() < reach
    assert np.abs(columns + 12 - 280).max() < reach


def test_a_short_future_lies_above_a_long_one(root: Path) -> None:
    chart = read_sheet(open_dataset(root), "g2")._chart
    nominal = chart.scene.nominal
    short = replace(nominal, policy=chart.scene.candidates[4].policy, x_m=nominal.x_m.copy(), y_m=nominal.y_m.copy())
    rows = np.flatnonzero(nominal.future)[6:]
    short.x_m[rows], short.y_m[rows] = nominal.x_m[rows[0]], nominal.y_m[rows[0]]
    for candidates in ((nominal, short), (short, nominal)):
        picture = replace(chart, scene=replace(chart.scene, candidates=candidates)).picture(0, None)
        seen = {pixel for _, pixel in picture.getcolors(1 << 20) or ()}
        assert {ink(chart.colours[one.policy.key]) for one in candidates} <= seen


@pytest.mark.parametrize(("tick", "colours"), [(None, (0, 1)), (50, (2, 2)), (55, (0, 1))])
def test_only_touches_in_the_future_are_red(root: Path, tick: int | None, colours: tuple[int, int]) -> None:
    nominal = read_sheet(open_dataset(root), "g2").scene.nominal
    _, gap, _, touch = outcome_inks(replace(nominal, touched=nominal.tick == tick))
    inks = [ink(BACKDROP["ink"]), ink(BACKDROP["quiet"]), (0xC0, 0, 0)]
    assert (inks.index(gap), inks.index(touch)) == colours


def test_classes_and_channels_have_colours() -> None:
    values = np.array([[kind | channel for kind in SemanticClass] for channel in (0, *SemanticChannel)], np.uint8)
    colours = coloured(values)
    assert len({tuple(colour) for colour in colours[0].tolist()}) == len(SemanticClass)
    assert (colours[0] != colours[-1]).any(axis=1).all()


@pytest.mark.parametrize(
    ("stream", "size"),
    [("semantic_bev", {"px_per_m": 1000.0}), ("rgb_surround", {"width_px": 16, "height_px": 16384})],
)
def test_no_declared_camera_makes_a_picture_large(
    root: Path, stream: str, size: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet, new = read_sheet(open_dataset(root), "g2"), Image.new
    chosen = next(one for one in sheet.descriptor.cameras if one.stream == stream)
    cameras = [one.model_copy(update=size) if one is chosen else one for one in sheet.descriptor.cameras]
    sheet = Sheet(sheet.scene, sheet.nominal, sheet.descriptor.model_copy(update={"cameras": tuple(cameras)}))

    def small(mode: str, extent: tuple[int, int], *colour: str) -> Image.Image:
        assert max(extent) < 4096
        return new(mode, extent, *colour)

    monkeypatch.setattr(Image, "new", small)
    assert max(sheet.picture().size) < 4096


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["g9"], "no group 'g9'"), (["g2", "--output", "a.jpg"], "ends neither with .png nor with .gif")],
)
def test_wrong_usage_is_one_line(root: Path, arguments: list[str], message: str) -> None:
    code, out, err = show(root, *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_a_dataset_without_media_says_how_to_add_them(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", map_tables(), map_descriptor())
    code, _, err = show(tmp_path / "d", "g0", "--output", tmp_path / "a.png")
    assert code == 2
    assert "has no media; add them with `branchdrive render`" in err
    (tmp_path / "d/.staging/render/frames").mkdir(parents=True)
    code, _, err = show(tmp_path / "d", "g0", "--output", tmp_path / "a.png")
    assert code == 2
    assert "has no media; a `branchdrive render` was interrupted: run it again" in err
