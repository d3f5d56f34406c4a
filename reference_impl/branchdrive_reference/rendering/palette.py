"""Colours of a rendered world, and how the hour and the weather of an environment change them.

Colours are blue, green and red, 0 to 255, as OpenCV orders them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

__all__ = ["LAMPS", "SURFACES", "Colour", "Daylight", "beam_of", "bgr", "daylight_of", "paint_of"]

Colour = tuple[int, int, int]
"""Blue, green, red."""


def bgr(code: str) -> Colour:
    """The colour of a code such as ``#66788f``."""
    red, green, blue = (int(code[at : at + 2], 16) for at in (1, 3, 5))
    return blue, green, red


SURFACES: Mapping[str, Colour] = MappingProxyType(
    {
        "grass": bgr("#6f8f57"),
        "road": bgr("#686a6e"),
        "parking": bgr("#74757a"),
        "shoulder": bgr("#5f6165"),
        "sidewalk": bgr("#a9a49a"),
        "kerb": bgr("#c9c6bf"),
        "paint": bgr("#f1f1ec"),
        "wall": bgr("#b5aca0"),
        "shadow": bgr("#3a3b40"),
    }
)

LAMPS: Mapping[str, Colour] = MappingProxyType(
    {"red": bgr("#ff2a1f"), "yellow": bgr("#ffc21a"), "green": bgr("#23d160")}
)
"""Lamps of a signal that are lit, by its state."""

_PAINTS: Mapping[str, tuple[Colour, ...]] = MappingProxyType(
    {
        "vehicle": tuple(
            map(bgr, ("#2f6db3", "#b3322f", "#e4e5e7", "#d9a21b", "#3b7d55", "#5c5f66", "#8e4c9e", "#c46a2b"))
        ),
        "cycle": tuple(map(bgr, ("#1f9fa8", "#c2477f"))),
        "pedestrian": tuple(map(bgr, ("#d1495b", "#edae49", "#3d78b8"))),
        "static": tuple(map(bgr, ("#e07b2c", "#8a7f72", "#c9b27a", "#59656f"))),
    }
)


def paint_of(actor_class: str, length_m: float, width_m: float, height_m: float) -> Colour:
    """Colour of an actor: by its class and extents alone.

    Numbers of actors may differ between the rollouts of a group and would show which of them this is.
    """
    paints = _PAINTS[actor_class]
    millimetres = [round(1000 * extent) for extent in (length_m, width_m, height_m)]
    key = millimetres[0] * 73_856_093 ^ millimetres[1] * 19_349_663 ^ millimetres[2] * 83_492_791
    return paints[(key >> 4) % len(paints)]


@dataclass(frozen=True)
class Daylight:
    """What the hour and the weather do to colours.

    Attributes:
        ambient: Share of the light of a clear day.
        headlamps: What the headlamps of the ego add to it where they shine brightest.
        zenith: Colour of the sky far above the horizon.
        haze: Colour of the sky at the horizon, and of what is far away.
        visibility_m: Distance at which two thirds of a colour have become haze.
    """

    ambient: float
    headlamps: float
    zenith: Colour
    haze: Colour
    visibility_m: float

    def lit(self, colours: NDArray[np.float64], beam: NDArray[np.float64] | float = 0.0) -> NDArray[np.float64]:
        """Colours ``[.., 3]`` in this light, before haze; `beam` is the share of the headlamps ``[.., 1]``."""
        return np.asarray(colours * (self.ambient + self.headlamps * beam))

    @property
    def has_headlamps(self) -> bool:
        """Whether the ego and other vehicles have their lamps on."""
        return self.headlamps > 0


_LAMPS_M, _BEAM_M, _BEAM_RAD = 1.5, 30.0, 0.55
"""Where the headlamps are, and how far and how wide their light reaches."""


def beam_of(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the light of the ego's headlamps at places of its frame, in ``[0, 1]``, same shape.

    ``share = (r / 6) exp(-(angle / width)^2) / (1 + (r / reach)^2)``, with ``r / 6`` at most 1.
    """
    ahead_m = x_m - _LAMPS_M
    reach_m, angle_rad = np.hypot(ahead_m, y_m), np.arctan2(y_m, ahead_m)
    near = np.minimum(reach_m / 6.0, 1.0)
    return np.asarray(near * np.exp(-((angle_rad / _BEAM_RAD) ** 2)) / (1.0 + (reach_m / _BEAM_M) ** 2))


_CLEAR = Daylight(1.0, 0.0, bgr("#5b93cf"), bgr("#cfdde8"), 170.0)
_WEATHERS: Mapping[str, Daylight] = MappingProxyType(
    {
        "night": Daylight(0.55, 0.7, bgr("#131d33"), bgr("#36425a"), 110.0),
        "fog": Daylight(0.85, 0.0, bgr("#b9c0c6"), bgr("#ccd1d5"), 45.0),
        "sunset": Daylight(0.82, 0.0, bgr("#5f6fa0"), bgr("#f0b58a"), 140.0),
        "rain": Daylight(0.78, 0.0, bgr("#7f8a95"), bgr("#aab2b9"), 90.0),
        "cloud": Daylight(0.90, 0.0, bgr("#93a3b3"), bgr("#c6ced5"), 150.0),
    }
)
"""By a word in the name of an environment; the first that occurs counts."""


def daylight_of(environment: str) -> Daylight:
    """Light of an environment by its name; that of a clear day where the name says nothing known."""
    name = environment.casefold()
    return next((light for word, light in _WEATHERS.items() if word in name), _CLEAR)
