"""Vertex tables of polylines, and a straight road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive_reference.geometry.polyline import VERTEX, Polyline


def path_of(line: Polyline, arc_zero_m: float = 0.0) -> NDArray[np.void]:
    """`VERTEX` rows of a polyline whose arc length `arc_zero_m` counts as 0."""
    path = np.zeros(len(line.x_m), VERTEX)
    path["x_m"], path["y_m"], path["tangent_rad"] = line.x_m, line.y_m, line.tangent_rad
    path["arc_m"] = line.arc_m - arc_zero_m
    return path


ROAD = path_of(Polyline(np.linspace(-50, 300, 351), np.zeros(351)), arc_zero_m=50.0)
"""A straight road along x; arc length is x."""
