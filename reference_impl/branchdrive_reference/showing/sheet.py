"""A contact sheet: the cameras around the ego, the bird's-eye view with all futures, and what became of them.

A sheet is read from a group of a dataset, and written as one picture, or as one for each observation in a loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from branchdrive.contract.camera import Camera, TopDownCamera
from branchdrive.contract.columns import STREAMS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.semantic_bev import SEMANTIC_STREAM
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S, WINDOW_OFFSETS
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.raw.media.camera_frames import CameraFrames
from branchdrive.raw.reader import Dataset
from branchdrive.raw.rollout import Rollout
from branchdrive.release.publish import is_rendering
from branchdrive_reference.drawing.elements import elements_around
from branchdrive_reference.drawing.palette import BACKDROP, candidate_colours
from branchdrive_reference.drawing.scene import HORIZON_S, Candidate, DrawnScene, outcome_texts, read_scene
from branchdrive_reference.rendering.snapshot import Playback
from branchdrive_reference.showing.chart import Chart, ink
from branchdrive_reference.study.bank import canonical_bank
from branchdrive_reference.study.label import label

__all__ = ["Sheet", "animated_bytes", "outcome_inks", "read_sheet", "sheet_bytes"]

_ROWS = (("front_left", "front", "front_right"), ("rear_left", "rear", "rear_right"))
_TILE_PX, _GAP_PX, _MARGIN_PX, _HEAD_PX = 384, 6, 16, 56
_CHART_PX = 560
_Ink = tuple[int, int, int]

_TABLE_PX = 44
"""Height of the heads of columns."""

_END = f"to +{ACTIVE_TICKS * TICK_S:.1f} s"
_COLUMNS = (
    (34, "candidate", "la"),
    (250, f"least gap\n{_END}", "ra"),
    (350, f"speed\n{_END.replace('to', 'at')}", "ra"),
    (480, f"first touch\nto +{HORIZON_S:.1f} s", "ra"),
)

_NOTE_PX = 18
_GROUND = "below the futures: what is recorded at each observation"
_FRAME = "in the frame: the semantic view; beyond it, and brown objects: what is recorded beside it"

_INK, _QUIET, _PAPER, _TOUCH = ink(BACKDROP["ink"]), ink(BACKDROP["quiet"]), (250, 250, 248), (0xC0, 0, 0)

_STEP_MS = round(1000 * OBSERVATION_STRIDE_TICKS * TICK_S)
_PAUSE_MS = 1500
"""How long the last picture stays before the first comes again."""

_SHARE = 2 / 3
"""Size of an animated picture by that of a sheet."""


@dataclass
class Sheet:
    """A group as it is shown.

    Attributes:
        scene: The group.
        nominal: Its nominal rollout, whose images are shown.
        descriptor: The dataset's descriptor.
    """

    scene: DrawnScene
    nominal: Rollout
    descriptor: Descriptor
    _frames: dict[str, CameraFrames] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._frames = {name: self.nominal.frames(name) for name in self._cameras}
        if not self._frames:
            raise UsageError(f"{self.descriptor.dataset_id!r} has no media; add them with `branchdrive render`")
        if not self.ticks:
            raise UsageError(
                f"group '{label(self.scene.record['group_id'])}' has no image of its nominal rollout around the branch"
            )

    @cached_property
    def _cameras(self) -> Mapping[str, Camera]:
        return {camera.name: camera for camera in self.descriptor.cameras}

    @cached_property
    def _bev(self) -> TopDownCamera | None:
        maps = [
            one for one in self.descriptor.cameras if isinstance(one, TopDownCamera) and one.stream == SEMANTIC_STREAM
        ]
        return maps[0] if maps else None

    @cached_property
    def _rows(self) -> tuple[tuple[str, ...], ...]:
        """Names of the cameras by rows: the six around the ego, or what else there is."""
        if all(name in self._cameras for row in _ROWS for name in row):
            return _ROWS
        others = tuple(name for name, camera in self._cameras.items() if camera.stream != SEMANTIC_STREAM)[:6]
        return tuple(others[at : at + 3] for at in range(0, len(others), 3))

    @cached_property
    def ticks(self) -> tuple[int, ...]:
        """Observations of the window that have an image, since the branch."""
        branch = self.nominal.branch_tick or 0
        seen = {int(tick) - branch for frames in self._frames.values() for tick in frames.ticks}
        return tuple(tick for tick in WINDOW_OFFSETS if tick in seen and tick in self.scene.nominal.tick)

    @cached_property
    def _chart(self) -> Chart:
        recording = Playback(self.nominal)
        return Chart(self.scene, recording, candidate_colours(self.scene.bank), _CHART_PX, self._bev)

    def picture(self, tick: int = 0) -> Image.Image:
        """The sheet at a tick since the branch."""
        tiles = [[self._tile(name, tick) for name in row] for row in self._rows]
        height = (
            _HEAD_PX + sum(max(tile.height for tile in row) + _GAP_PX for row in tiles) + _CHART_PX + 2 * _MARGIN_PX
        )
        width = 2 * _MARGIN_PX + 3 * _TILE_PX + 2 * _GAP_PX
        sheet = Image.new("RGB", (width, height), _PAPER)
        draw = ImageDraw.Draw(sheet)
        self._write_head(draw, tick, width)
        top = _HEAD_PX
        for names, row in zip(self._rows, tiles, strict=True):
            for column, (name, tile) in enumerate(zip(names, row, strict=True)):
                left = _MARGIN_PX + column * (_TILE_PX + _GAP_PX)
                sheet.paste(tile, (left, top))
                _write_over(draw, (left + 12, top + 16), name.replace("_", " "))
            top += max(tile.height for tile in row) + _GAP_PX
        top += _MARGIN_PX
        sheet.paste(self._chart.picture(tick, self._view(tick)), (_MARGIN_PX, top))
        self._write_outcomes(draw, (_MARGIN_PX + _CHART_PX + 28, top), tick)
        return sheet

    def animation(self) -> Iterator[Image.Image]:
        """The sheet at every observation of the window that has images."""
        return (self.picture(tick) for tick in self.ticks)

    def _pixels(self, name: str, tick: int) -> NDArray[np.uint8] | None:
        frames = self._frames[name]
        at = np.flatnonzero(frames.ticks == tick + (self.nominal.branch_tick or 0))
        return frames[int(at[0])].pixels() if len(at) else None

    def _tile(self, name: str, tick: int) -> Image.Image:
        camera, pixels = self._cameras[name], self._pixels(name, tick)
        height = round(_TILE_PX * camera.height_px / camera.width_px)
        size = (_TILE_PX, min(max(1, height), 2 * _TILE_PX))
        if pixels is None:
            return Image.new("RGB", size, _QUIET)
        return Image.fromarray(pixels).convert("RGB").resize(size, Image.Resampling.LANCZOS)

    def _view(self, tick: int) -> NDArray[np.uint8] | None:
        return None if self._bev is None else self._pixels(self._bev.name, tick)

    def _write_head(self, draw: ImageDraw.ImageDraw, tick: int, width: int) -> None:
        record = self.scene.record
        draw.text((_MARGIN_PX, 10), label(record["group_id"]), fill=_INK, font=_font(20))
        places = ", ".join(label(record[name]) for name in ("scenario_type", "town", "environment"))
        draw.text((_MARGIN_PX, 34), places, fill=_QUIET, font=_font(13))
        phase = "history" if tick < 0 else "branch" if tick == 0 else "nominal future"
        when = f"{phase}, {tick * TICK_S:+.2f} s"
        draw.text((width - _MARGIN_PX, 14), when, fill=_INK, font=_font(18), anchor="ra")

    def _write_outcomes(self, draw: ImageDraw.ImageDraw, corner: tuple[int, int], tick: int) -> None:
        left, top = corner
        for x, text, anchor in _COLUMNS:
            for line, words in enumerate(text.split("\n")):
                draw.text((left + x, top + 16 * line), words, fill=_QUIET, font=_font(13), anchor=anchor)
        colours = candidate_colours(self.scene.bank)
        step = min(34.0, (_CHART_PX - _TABLE_PX - 2 * _NOTE_PX) / max(1, len(self.scene.candidates)))
        for number, candidate in enumerate(self.scene.candidates):
            middle = top + _TABLE_PX + (number + 0.5) * step
            colour = ink(colours[candidate.policy.key])
            draw.rounded_rectangle((left, middle - 5, left + 24, middle + 5), 5, fill=colour)
            inks = outcome_inks(candidate)
            for (x, _, _), text, fill, anchor in zip(
                _COLUMNS, outcome_texts(candidate), inks, ("lm", "rm", "rm", "rm"), strict=True
            ):
                draw.text((left + x, middle), text, fill=fill, font=_font(15), anchor=anchor)
        until = tick if tick > 0 else ACTIVE_TICKS
        notes = (
            f"left: the nominal ego, heading up; futures to {until * TICK_S:+.2f} s, a cross where a touch begins",
            _GROUND if self._bev is None else _FRAME,
        )
        for line, note in enumerate(notes):
            middle = top + _CHART_PX - (len(notes) - line - 0.5) * _NOTE_PX
            draw.text((left, middle), note, fill=_QUIET, font=_font(12), anchor="lm")


def read_sheet(dataset: Dataset, group_id: str) -> Sheet:
    """The sheet of a group.

    Raises:
        UsageError: The dataset has no media, or the group cannot be shown.
        DatasetError: A file cannot be read.
    """
    descriptor = dataset.descriptor
    if not any(STREAMS[name].cameras for name in descriptor.streams):
        advice = "add them with `branchdrive render`"
        if isinstance(dataset.store, Folder) and is_rendering(dataset.root):
            advice = "a `branchdrive render` was interrupted: run it again"
        raise UsageError(f"{str(dataset.store)!r} has no media; {advice}")
    group = dataset.group(group_id)
    scene = read_scene(group, descriptor)
    scene = replace(scene, elements=elements_around(dataset, scene))
    bank = dict(zip(descriptor.action_bank.keys, canonical_bank(group, descriptor), strict=True))
    return Sheet(scene, bank[descriptor.action_bank.nominal.key], descriptor)


def sheet_bytes(sheet: Sheet) -> bytes:
    """The sheet of the branch as a PNG."""
    stream = BytesIO()
    sheet.picture().save(stream, "PNG", optimize=True)
    return stream.getvalue()


def animated_bytes(sheet: Sheet, show: Callable[[int, int], None]) -> bytes:
    """The sheets of all observations as a GIF in a loop, at the pace of the world; `show` hears of each."""
    pictures: list[Image.Image] = []
    for picture in sheet.animation():
        size = (round(picture.width * _SHARE), round(picture.height * _SHARE))
        pictures.append(picture.resize(size, Image.Resampling.LANCZOS).quantize(256, Image.Quantize.FASTOCTREE))
        show(len(pictures), len(sheet.ticks))
    stream = BytesIO()
    pauses = [_STEP_MS] * (len(pictures) - 1) + [_PAUSE_MS]
    pictures[0].save(stream, "GIF", save_all=True, append_images=pictures[1:], duration=pauses, loop=0, disposal=1)
    return stream.getvalue()


def outcome_inks(candidate: Candidate) -> tuple[_Ink, _Ink, _Ink, _Ink]:
    """Colours of the texts of an outcome: a touch in the future is red, and one after it grey."""
    begins = candidate.tick[candidate.contacts]
    if (begins <= ACTIVE_TICKS).any():
        return _INK, _TOUCH, _TOUCH, _TOUCH
    return _INK, _INK, _INK, _QUIET


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _write_over(draw: ImageDraw.ImageDraw, at: tuple[int, int], text: str) -> None:
    """Text that can be read on any image."""
    left, top = at
    right = left + draw.textlength(text, _font(14))
    draw.rounded_rectangle((left - 6, top - 10, right + 6, top + 10), 4, fill=_INK)
    draw.text(at, text, fill="white", font=_font(14), anchor="lm")
