"""The map layer: paved ground, carriageways, crossings, markings, kerbs and walls around the branch."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.path import Path
from numpy.typing import NDArray

from branchdrive_reference.drawing.palette import BACKDROP, Rgb
from branchdrive_reference.drawing.view import Layer, View
from branchdrive_reference.geometry.polyline import Polyline
from branchdrive_reference.town.elements import Element

__all__ = ["draw_roads", "elements_in_view"]

Points = NDArray[np.float64]
"""Points of the view frame ``[points, 2]``."""

_DASHES = (0.0, (6.0, 6.0))
_MARGIN_M = 25.0

_PAVED = ("lane", "shoulder", "parking")


def elements_in_view(elements: Iterable[Element], view: View) -> list[Element]:
    """Elements that may be seen, in their order."""
    return [element for element in elements if view.sees(*view.place(element["x_m"], element["y_m"]), _MARGIN_M)]


def draw_roads(axes: Axes, elements: Sequence[Element], view: View) -> None:
    """Draw the map below everything else."""
    seen = elements_in_view(elements, view)
    lanes = _strips(seen, view, "lane")
    areas = {element["element_id"]: _placed(element, view) for element in seen if element["kind"] == "road_area"}
    paved = [*(strip for kind in _PAVED for strip in _strips(seen, view, kind)), *areas.values()]
    _fill(axes, paved, Layer.GROUND, BACKDROP["kerb"], edge_pt=1.6)
    _fill(axes, paved, Layer.PAVED, BACKDROP["paved"], edge_pt=0.0)
    _fill(axes, _strips(seen, view, "parking"), Layer.PAVED, BACKDROP["parking"], edge_pt=0.0)
    _fill(axes, [*lanes, *_sweeps(seen, view, list(areas.values()))], Layer.CARRIAGEWAY, BACKDROP["carriageway"],
          edge_pt=0.6)  # fmt: skip
    crossings = [_placed(element, view) for element in seen if element["kind"] == "crossing"]
    _fill(axes, crossings, Layer.MARKING, BACKDROP["marking"], edge_pt=0.0, alpha=0.5)
    _draw_lines(axes, seen, view)


def _placed(element: Element, view: View) -> Points:
    return np.stack(view.place(element["x_m"], element["y_m"]), axis=1)


def _edges(element: Element, view: View) -> tuple[Points, Points]:
    """Left and right edge of a strip."""
    line = Polyline(element["x_m"], element["y_m"])
    half = element["width_m"] / 2
    left, right = (line.shifted(side) for side in (half, -half))
    return np.stack(view.place(left.x_m, left.y_m), axis=1), np.stack(view.place(right.x_m, right.y_m), axis=1)


def _strips(elements: Iterable[Element], view: View, kind: str) -> list[Points]:
    """Outlines of the strips of a kind."""
    edges = [_edges(element, view) for element in elements if element["kind"] == kind]
    return [np.concatenate([left, right[::-1]]) for left, right in edges]


def _sweeps(elements: Iterable[Element], view: View, areas: Sequence[Points]) -> list[Points]:
    """What lies between the lanes that cross a road area and its middle."""
    parts = []
    for element in elements:
        if element["kind"] != "lane":
            continue
        middle = _placed(element, view)[len(element["x_m"]) // 2]
        for area in areas:
            if Path(area).contains_point(tuple(middle)):
                parts += [np.concatenate([area.mean(axis=0)[None], edge]) for edge in _edges(element, view)]
    return parts


def _fill(
    axes: Axes, outlines: Sequence[Points], layer: Layer, colour: Rgb, *, edge_pt: float, alpha: float = 1.0
) -> None:
    edge = colour if edge_pt else "none"
    axes.add_collection(
        PolyCollection(
            list(outlines), facecolors=[(*colour, alpha)], edgecolors=edge, linewidths=edge_pt, zorder=layer
        ),
        autolim=False,
    )


def _draw_lines(axes: Axes, elements: Sequence[Element], view: View) -> None:
    """Markings of lane borders, kerbs and walls; lanes without borders get faint edges."""
    borders = [element for element in elements if element["kind"] == "lane_border"]
    styles: dict[str, tuple[list[Points], dict[str, Any]]] = {
        "solid": ([], {"colors": [BACKDROP["marking"]], "linewidths": 1.1}),
        "broken": ([], {"colors": [BACKDROP["marking"]], "linewidths": 1.1, "linestyles": [_DASHES]}),
        "edge": ([], {"colors": [BACKDROP["paved"]], "linewidths": 0.8}),
        "kerb": ([], {"colors": [BACKDROP["kerb"]], "linewidths": 1.2}),
        "wall": ([], {"colors": [BACKDROP["ink"]], "linewidths": 1.8}),
    }
    for element in borders:
        marking = element.get("marking")
        styles[marking if marking in ("solid", "broken") else "edge"][0].append(_placed(element, view))
    for element in elements:
        if element["kind"] in ("kerb", "wall"):
            styles[element["kind"]][0].append(_placed(element, view))
        elif element["kind"] == "lane" and not borders:
            styles["edge"][0].extend(_edges(element, view))
    for lines, style in styles.values():
        axes.add_collection(LineCollection(lines, **style, zorder=Layer.MARKING), autolim=False)
