"""The images of all cameras at one observation.

Images are functions of the map, the environment and the recorded state of their observation, and of nothing else:
equal states give equal bytes, whatever comes before or after them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import Camera, PinholeCamera
from branchdrive.errors import UsageError
from branchdrive_reference.rendering.opencv import Image
from branchdrive_reference.rendering.palette import daylight_of
from branchdrive_reference.rendering.patch import Tile, Town
from branchdrive_reference.rendering.semantic import SemanticView
from branchdrive_reference.rendering.snapshot import Snapshot
from branchdrive_reference.rendering.surroundings import Surroundings
from branchdrive_reference.rendering.view import View

__all__ = ["Renderer"]

_Texture = tuple[Image, NDArray[np.float64]]


_PAINT_MARGIN = 1.2
"""Lines are nearer to the cameras than their distance to the ego says, at the sides and where they are long."""


class Renderer:
    """Draws the cameras of one town in one environment.

    Args:
        town: The recorded town.
        environment: Name of the hour and the weather.
        cameras: What is drawn.

    Raises:
        UsageError: A camera is of a kind that is not drawn.
    """

    _MOST_TEXTURES = 4

    def __init__(self, town: Town, environment: str, cameras: Sequence[Camera]) -> None:
        self._town = town
        self._light = daylight_of(environment)
        self._views: dict[str, View] = {}
        self._maps: dict[str, SemanticView] = {}
        for camera in cameras:
            if isinstance(camera, PinholeCamera):
                self._views[camera.name] = View(camera, self._light)
            elif camera.stream == "semantic_bev":
                self._maps[camera.name] = SemanticView(camera)
            else:
                raise UsageError(f"camera `{camera.name}`: `rgb_top_down` is drawn by a pinhole camera above the ego")
        self._textures = lru_cache(maxsize=self._MOST_TEXTURES)(self._make_textures)

    def _make_textures(self, tile: Tile) -> tuple[_Texture, _Texture]:
        patch = self._town.patch(tile)
        fine, coarse = patch.looks(self._light)
        return (fine, patch.to_world), (coarse, patch.coarse_to_world)

    def images(self, snapshot: Snapshot) -> Mapping[str, Image]:
        """The image of every camera by its name: blue, green and red, or one channel of a semantic view."""
        tile = Tile.of(snapshot.x_m, snapshot.y_m)
        patch = self._town.patch(tile)
        images = {name: view.draw(patch, snapshot) for name, view in self._maps.items()}
        if self._views:
            surroundings: dict[bool, Surroundings] = {}
            for name, view in self._views.items():
                from_above = view.camera.stream == "rgb_top_down"
                if from_above not in surroundings:
                    surroundings[from_above] = Surroundings(
                        patch, self._textures(tile), snapshot, self._light,
                        focal_px=view.camera.fx_px, paint_reach_m=_PAINT_MARGIN * view.paint_reach_m,
                        shows_ego=from_above,
                    )  # fmt: skip
                images[name] = view.draw(surroundings[from_above])
        return images
