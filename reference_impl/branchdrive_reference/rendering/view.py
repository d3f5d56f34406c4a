"""Images of pinhole cameras: sky, ground by a homography, painted lines, and boxes from far to near."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.camera import PinholeCamera
from branchdrive_reference.rendering.opencv import SUBPIXEL_BITS, Image, cv2, fixed_point
from branchdrive_reference.rendering.palette import Daylight, beam_of
from branchdrive_reference.rendering.projection import Pinhole
from branchdrive_reference.rendering.surroundings import Surroundings

__all__ = ["View"]

Array = NDArray[np.float64]

NEAR_M = 0.3
"""Nothing nearer to a camera is drawn."""

_LEAST_GAIN = 1.01
"""Less light of the headlamps on the ground is not drawn."""

_FINE_PX_PER_M = 1.5
"""Where a metre of the ground has fewer pixels, it is drawn from the coarse texture."""


class _Band(NamedTuple):
    """Rows of an image from `first` on, the ground of which comes from one texture, and pixels moved to them."""

    first: int
    end: int
    level: int
    shift: Array

    @classmethod
    def of(cls, first: int, end: int, level: int) -> _Band:
        return cls(first, end, level, np.array([[1, 0, -0.5], [0, 1, -0.5 - first], [0, 0, 1.0]]))


@dataclass(frozen=True, eq=False)
class View:
    """A camera in a light, ready to draw.

    Attributes:
        camera: The camera.
        light: The light.
    """

    camera: PinholeCamera
    light: Daylight

    @cached_property
    def _pinhole(self) -> Pinhole:
        return Pinhole(self.camera)

    @cached_property
    def _backdrop(self) -> Image:
        """The sky: from haze at the horizon to the zenith, and haze wherever no ground is seen."""
        camera, pinhole = self.camera, self._pinhole
        rows = np.arange(camera.height_px) + 0.5
        middle = np.stack([np.full(camera.height_px, camera.cx_px), rows, np.ones(camera.height_px)])
        rays = np.linalg.inv(pinhole.intrinsics) @ middle
        rise = (pinhole.axes[:, 2] @ rays) / np.linalg.norm(rays, axis=0)
        share = np.clip(rise / 0.55, 0.0, 1.0)[:, None] ** 0.7
        colours = np.array(self.light.haze) * (1 - share) + np.array(self.light.zenith) * share
        return np.ascontiguousarray(
            np.broadcast_to(np.rint(colours)[:, None, :], (camera.height_px, camera.width_px, 3)).astype(np.uint8)
        )

    @cached_property
    def _haze(self) -> NDArray[np.float32]:
        """Share of haze over the ground for each pixel, 1 above the horizon ``[height, width]``."""
        return np.asarray(1.0 - np.exp(-self._pinhole.depth_m / self.light.visibility_m), np.float32)

    @cached_property
    def _bands(self) -> tuple[_Band, ...]:
        """Rows of the ground from the coarse and from the fine texture."""
        depth_m = self._pinhole.depth_m.min(axis=1)
        seen = np.flatnonzero(np.isfinite(depth_m))
        if not len(seen):
            return ()
        first, end = int(seen[0]), int(seen[-1]) + 1
        density = np.sqrt(abs(np.linalg.det(self._pinhole.ground)) / np.maximum(depth_m, NEAR_M) ** 3)
        near = np.flatnonzero(density[first:end] >= _FINE_PX_PER_M)
        middle = first + int(near[0]) if len(near) else end
        bands = ((first, middle, 1), (middle, end, 0))
        return tuple(_Band.of(*band) for band in bands if band[1] > band[0])

    @property
    def paint_reach_m(self) -> float:
        """Distance from which on the ground is drawn from the coarse texture; ``inf`` where all of it is fine."""
        coarse = [band.end for band in self._bands if band.level]
        return float(self._pinhole.depth_m[coarse[0] - 1].max()) if coarse else float("inf")

    def draw(self, surroundings: Surroundings) -> Image:
        """The image of the camera ``[height, width, 3]``."""
        image = self._backdrop.copy()
        self._draw_ground(image, surroundings)
        self._draw_outlines(image, surroundings)
        return image

    def _draw_ground(self, image: Image, surroundings: Surroundings) -> None:
        to_pixels = self._pinhole.ground @ surroundings.world_to_ego
        for first, end, level, shift in self._bands:
            texture, to_world = surroundings.textures[level]
            part = image[first:end]
            ground = cv2.warpPerspective(
                texture, shift @ to_pixels @ to_world, (part.shape[1], part.shape[0]), flags=cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT, borderValue=surroundings.beyond,
            )  # fmt: skip
            if self._gain is not None:
                cv2.multiply(ground, self._gain[first:end], ground, dtype=cv2.CV_8U)
            haze = self._haze[first:end]
            cv2.blendLinear(ground, part, self._clear[first:end], haze, part)

    @cached_property
    def _gain(self) -> NDArray[np.float32] | None:
        """How much brighter the headlamps make the ground ``[height, width, 3]``; ``None`` where they do not."""
        beam = np.nan_to_num(beam_of(*np.moveaxis(self._pinhole.ground_m, -1, 0)))
        gain = 1.0 + self.light.headlamps / self.light.ambient * beam
        if gain.max() < _LEAST_GAIN:
            return None
        return np.repeat(gain[..., None], 3, axis=2).astype(np.float32)

    @cached_property
    def _clear(self) -> NDArray[np.float32]:
        return np.asarray(1.0 - self._haze, np.float32)

    @cached_property
    def _frustum(self) -> tuple[Array, Array]:
        return self._pinhole.frustum(NEAR_M)

    def _draw_outlines(self, image: Image, surroundings: Surroundings) -> None:
        """Fill what faces the camera and is in its view, in the order of the surroundings."""
        pinhole, (normals, distances_m) = self._pinhole, self._frustum
        is_facing = surroundings.normals @ pinhole.place_m > surroundings.offsets_m
        inside = (normals @ surroundings.corners_m > distances_m[:, None]).reshape(len(normals), 4, -1)
        meets = inside[:, 0] | inside[:, 1] | inside[:, 2] | inside[:, 3]
        chosen = np.flatnonzero(np.logical_and.reduce(meets) & is_facing)
        near = np.flatnonzero(~np.logical_and.reduce(inside[0])[chosen])
        seen = pinhole.seen(surroundings.outlines_m[chosen])
        clipped = [_clipped(seen[number]) for number in near]
        seen[near] = 1.0
        outlines = list(fixed_point(pinhole.pixels(seen)))
        for number, outline in zip(near.tolist(), clipped, strict=True):
            outlines[number] = fixed_point(pinhole.pixels(outline))
        for outline, colour in zip(outlines, surroundings.colours[chosen].tolist(), strict=True):
            if len(outline) > 2:
                cv2.fillConvexPoly(image, outline, colour, cv2.LINE_AA, SUBPIXEL_BITS)


def _clipped(outline_m: Array) -> Array:
    """The part of a convex outline ``[corners, 3]`` that lies beyond `NEAR_M`."""
    kept: list[Array] = []
    for here, there in zip(outline_m, np.roll(outline_m, -1, axis=0), strict=True):
        if here[2] > NEAR_M:
            kept.append(here)
        if (here[2] > NEAR_M) != (there[2] > NEAR_M):
            kept.append(here + (NEAR_M - here[2]) / (there[2] - here[2]) * (there - here))
    return np.array(kept).reshape(-1, 3)
