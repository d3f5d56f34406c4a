"""The collector for highway-env with images: the program's own view from above, turned into the frame of the ego.

``python -m examples.highway_env.filmed build/filmed --groups 3``, with ``pip install 'branchdrive[examples,media]'``.

highway-env draws a world that stands still on the screen; a camera of a dataset moves and turns with the ego. So the
world is drawn around the ego, turned until the ego's heading is up, and cut to the camera's image.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from io import BytesIO

import numpy as np
import pygame
from examples.highway_env import collector
from highway_env.road.graphics import RoadGraphics, WorldSurface
from PIL import Image

import branchdrive as bd

CAMERA = bd.TopDownCamera(
    name="top_down", stream="rgb_top_down", width_px=128, height_px=128, px_per_m=3.0, origin_row_px=96.0,
    origin_column_px=64.0,
)  # fmt: skip
HALF_PX = 128
"""Half of the side of what is drawn: whatever the heading, it covers the image."""


class FilmedWorld(collector.HighwayWorld):
    """A scene that is seen from above."""

    def frames(self) -> Mapping[str, bytes]:
        """The view around the ego as a PNG."""
        surface = WorldSurface((2 * HALF_PX, 2 * HALF_PX), 0, pygame.Surface((2 * HALF_PX, 2 * HALF_PX), 0, 24))
        surface.scaling = CAMERA.px_per_m
        surface.move_display_window_to(self.ego.position)
        RoadGraphics.display(self.road, surface)
        RoadGraphics.display_road_objects(self.road, surface, offscreen=True)
        RoadGraphics.display_traffic(self.road, surface, offscreen=True)
        drawn = Image.fromarray(np.ascontiguousarray(pygame.surfarray.array3d(surface).transpose(1, 0, 2)))
        turned = drawn.rotate(90.0 + float(np.degrees(self.ego.heading)), Image.Resampling.BILINEAR)
        left, top = HALF_PX - CAMERA.origin_column_px, HALF_PX - CAMERA.origin_row_px
        stream = BytesIO()
        turned.crop((left, top, left + CAMERA.width_px, top + CAMERA.height_px)).save(stream, "PNG")
        return {CAMERA.name: stream.getvalue()}


WORLDS = {name: partial(FilmedWorld, name) for name in collector.SETTINGS}


def describe(seed: int) -> bd.Descriptor:
    """The dataset with the stream of its camera."""
    plain = collector.describe(seed)
    return plain.model_copy(update={"streams": (*plain.streams, CAMERA.stream), "cameras": (CAMERA,)})


if __name__ == "__main__":
    sys.exit(bd.collector_main(describe, WORLDS, **collector.options()))
