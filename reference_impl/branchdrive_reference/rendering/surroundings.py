"""Everything that the cameras of one observation see, as flat outlines that are computed once for all of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.rendering.opencv import Image
from branchdrive_reference.rendering.palette import SURFACES, Colour, Daylight, beam_of
from branchdrive_reference.rendering.part import FACES, Bodies, Parts, actor_parts, post_parts, shadows, wall_parts
from branchdrive_reference.rendering.patch import Patch, governing_signal
from branchdrive_reference.rendering.snapshot import Snapshot

__all__ = ["Surroundings"]

Array = NDArray[np.float64]

_POSTS_M, _WALLS_M, _SHADOWS_M = 90.0, 60.0, 60.0
"""How far signals and signs, walls, and shadows are drawn."""

_DETAIL_PX, _MOST_DETAIL_M = 6.0, 60.0
"""Small parts of actors are drawn where a metre has this many pixels, as far as the second."""

_SHADES = np.array([0.92, 0.8, 0.86, 0.74, 1.05])
"""Light on the front, left, rear, right and upper face of a box, without the sun."""

_LAMP_HAZE = 0.35
"""Share of their distance through whose haze lamps are seen."""

_SUN = np.array([math.cos(0.9), math.sin(0.9)])
_SUN_SHARE = 0.12
"""Direction of the sun in the world, and how much brighter faces towards it are."""


class Surroundings:
    """What stands and lies around the ego at one observation, in the ego's frame.

    Args:
        patch: The world around the ego.
        textures: Fine and coarse ground, each with its map from pixels to the world.
        snapshot: The recorded state.
        light: The light.
        focal_px: Focal length of the cameras, which decides what is too small to be drawn.
        paint_reach_m: Distance beyond which painted lines are part of the coarse texture.
        shows_ego: Whether the ego is among the bodies.

    Attributes:
        textures: As given.
        world_to_ego: World points ``(x, y, 1)`` to the ego's frame ``[3, 3]``.
        beyond: Colour of the ground where the textures end.
        outlines_m: Corners of what is drawn, in the order of drawing ``[outlines, 4, 3]``.
        corners_m: The same as columns, the first corners of all outlines first ``[3, 4 * outlines]``.
        normals: Directions from which they are seen ``[outlines, 3]``.
        offsets_m: Distances of their planes from the origin, along the normals ``[outlines]``.
        colours: Blue, green and red in the light and behind the haze ``[outlines, 3]``.
    """

    def __init__(
        self,
        patch: Patch,
        textures: tuple[tuple[Image, Array], tuple[Image, Array]],
        snapshot: Snapshot,
        light: Daylight,
        *,
        focal_px: float,
        paint_reach_m: float,
        shows_ego: bool = False,
    ) -> None:
        self.textures = textures
        self._patch, self._snapshot, self._light = patch, snapshot, light
        self._focal_px, self._paint_reach_m = focal_px, paint_reach_m
        cos, sin = math.cos(snapshot.yaw_rad), math.sin(snapshot.yaw_rad)
        self._turn = np.array([[cos, sin], [-sin, cos]])
        self._here = np.array([snapshot.x_m, snapshot.y_m])
        self.world_to_ego = np.eye(3)
        self.world_to_ego[:2, :2], self.world_to_ego[:2, 2] = self._turn, -self._turn @ self._here
        blue, green, red = light.lit(np.array(SURFACES["grass"], float)).tolist()
        self.beyond: Colour = (int(blue), int(green), int(red))
        paint, paint_colours, paint_m = self._paint()
        parts = self._parts(shows_ego=shows_ego)
        faces, normals, face_colours, face_m, glows = self._faces(parts)
        self.outlines_m = np.concatenate([paint, faces])
        self.corners_m = self.outlines_m.transpose(2, 1, 0).reshape(3, -1)
        self.normals = np.concatenate([np.tile([0.0, 0.0, 1.0], (len(paint), 1)), normals])
        self.offsets_m = (self.outlines_m[:, 0] * self.normals).sum(axis=1)
        self.colours = self._behind_haze(
            np.concatenate([paint_colours, face_colours]),
            np.concatenate([paint_m, face_m]),
            np.concatenate([np.zeros(len(paint), bool), glows]),
        )

    def _placed(self, points_m: Array) -> Array:
        """World points ``[.., 2]`` in the ego's frame, same shape."""
        return np.asarray((points_m - self._here) @ self._turn.T)

    def _behind_haze(self, colours: Array, distance_m: Array, glows: NDArray[np.bool_]) -> Array:
        beam: Array | float = 0.0
        if self._light.has_headlamps:
            places = self.outlines_m[..., :2].mean(axis=1)
            beam = beam_of(places[:, 0], places[:, 1])[:, None]
        lit = np.minimum(self._light.lit(colours, beam), 255.0)
        lit[glows] = colours[glows]
        share = 1.0 - np.exp(distance_m / -self._light.visibility_m)[:, None]
        return np.minimum(lit * (1 - share) + np.array(self._light.haze, float) * share, 255.0)

    def _paint(self) -> tuple[Array, Array, Array]:
        """Outlines of painted lines ``[lines, 4, 3]``, their colours, and their distances.

        Filling widens an outline by about a pixel: the colour of a line makes up for it.
        """
        paint = self._patch.paint
        distance = np.hypot(*((paint.start_m + paint.end_m) / 2 - self._here).T)
        near = np.flatnonzero(distance < self._paint_reach_m)
        distance = distance[near]
        outlines = np.zeros((len(near), 4, 3))
        outlines[..., :2] = self._placed(self._patch.paint_corners[near])
        width_px = (paint.width_m[near] * self._focal_px / np.maximum(distance, 1.0))[:, None]
        cover = width_px / (width_px + 1.0)
        colours = np.array(SURFACES["paint"]) * cover + np.array(SURFACES["road"]) * (1 - cover)
        return outlines, colours, distance

    def _parts(self, *, shows_ego: bool) -> Parts:
        """All boxes: shadows, and then the others from far to near."""
        snapshot = self._snapshot
        actors = snapshot.actors
        places = self._placed(np.stack([actors.x_m, actors.y_m], axis=1))
        bodies = Bodies(
            list(actors.actor_class), places[:, 0], places[:, 1], actors.yaw_rad - snapshot.yaw_rad,
            np.stack([actors.length_m, actors.width_m, actors.height_m], axis=1),
        )  # fmt: skip
        if shows_ego:
            bodies = bodies.with_ego(snapshot.length_m, snapshot.width_m, snapshot.height_m)
        detail_m = min(self._focal_px / _DETAIL_PX, _MOST_DETAIL_M)
        has_lamps_on = self._light.has_headlamps
        lying = shadows(bodies, _SHADOWS_M)
        standing = actor_parts(bodies, detail_m, has_lamps_on=has_lamps_on), self._posts(), self._walls()
        return Parts.joined([lying, *standing]).far_to_near(len(lying))

    def _posts(self) -> Parts:
        posts = self._patch.posts
        places = self._placed(self._patch.post_places_m)
        number = governing_signal(posts, places, self._snapshot.lane_id) if self._snapshot.light else None
        near = np.flatnonzero(np.hypot(*places.T) < _POSTS_M).tolist()
        lit = {near.index(number): str(self._snapshot.light)} if number in near else {}
        return post_parts([posts[i] for i in near], places[near], lit)

    def _walls(self) -> Parts:
        walls = self._patch.walls
        near = np.hypot(*((walls.start_m + walls.end_m) / 2 - self._here).T) < _WALLS_M
        chosen = walls.chosen(near)
        return wall_parts(chosen, self._placed(chosen.start_m), self._placed(chosen.end_m))

    def _faces(self, parts: Parts) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """Faces of boxes in their order: outlines, normals, colours, lengths of their haze, and whether they glow."""
        cos, sin = np.cos(parts.yaw_rad), np.sin(parts.yaw_rad)
        normals = np.zeros((len(parts), 5, 3))
        normals[:, 0, 0], normals[:, 0, 1] = cos, sin
        normals[:, 1, 0], normals[:, 1, 1] = -sin, cos
        normals[:, 2], normals[:, 3] = -normals[:, 0], -normals[:, 1]
        normals[:, 4, 2] = 1.0
        colours = np.repeat(parts.side[:, None], 5, axis=1)
        colours[:, 4] = parts.top
        shades = _SHADES + _SUN_SHARE * (normals[..., :2] @ (self._turn @ _SUN))
        shades[parts.glows] = 1.0
        shown = parts.has_face
        haze_m = parts.distance_m * np.where(parts.glows, _LAMP_HAZE, 1.0)
        owner = np.nonzero(shown)[0]
        outlines, lit = parts.corners()[:, FACES][shown], (colours * shades[..., None])[shown]
        return outlines, normals[shown], lit, haze_m[owner], parts.glows[owner]
