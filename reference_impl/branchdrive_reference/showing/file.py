"""Sheets as files: one picture, or one for each observation in a loop."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

from PIL import Image

from branchdrive.contract.timing import OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive_reference.showing.sheet import Sheet

__all__ = ["animated_bytes", "sheet_bytes"]

_STEP_MS = round(1000 * OBSERVATION_STRIDE_TICKS * TICK_S)
_PAUSE_MS = 1500
"""How long the last picture stays before the first comes again."""

_SHARE = 2 / 3
"""Size of an animated picture by that of a sheet."""


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
