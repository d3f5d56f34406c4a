"""Sizes of boxes of a pilot, against what road users measure: half extents and centimetres show here.

Source: spec/02-time-frames-units.md#frames; the ranges hold every common car, truck, bus, cycle and person.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from branchdrive.contract.text import NONE
from branchdrive.pilot.section import Concern
from branchdrive.raw.shard_view import ShardView
from branchdrive.text.table import Column, Table

__all__ = ["Extents", "extents"]


class _Range(NamedTuple):
    """Least and largest median of a size that raises no question, metres."""

    low: float
    high: float


_PLAUSIBLE: Mapping[str, tuple[_Range, _Range]] = {
    "ego": (_Range(2.9, 20.0), _Range(1.3, 3.2)),
    "vehicle": (_Range(2.9, 20.0), _Range(1.3, 3.2)),
    "cycle": (_Range(1.2, 3.0), _Range(0.3, 1.3)),
    "pedestrian": (_Range(0.2, 1.2), _Range(0.25, 1.2)),
}
"""Medians of length and width of each kind; statics are of any size."""


_LONGER = 1.05
"""Wheelbase over length above which extents are halves: cars have 0.5 to 0.7, and a model's may be the whole length."""


class Extents(NamedTuple):
    """Sizes as a table, what is wrong with them, and the medians for programs."""

    table: Table
    concerns: list[Concern]
    figures: dict[str, dict[str, Any]]


def extents(views: Sequence[ShardView]) -> Extents:
    """Sizes of the ego and of actors by class, and the wheelbase that the descriptor declares."""
    rows: list[list[str]] = []
    found: dict[str, tuple[float, float]] = {}
    figures: dict[str, dict[str, Any]] = {}
    for kind, sizes in _sizes(views).items():
        medians = [float(np.median(values)) if len(values) else None for values in sizes]
        figures[kind] = dict(zip(("length_m", "width_m", "height_m"), medians, strict=True)) | {"boxes": len(sizes[0])}
        plausible = _PLAUSIBLE.get(kind)
        rows.append(
            [
                kind,
                f"{len(sizes[0]):,}",
                *(NONE if median is None else f"{median:.2f}" for median in medians),
                NONE if plausible is None else " x ".join(f"{low:g} to {high:g}" for low, high in plausible),
            ]
        )
        if plausible is not None and medians[0] is not None and medians[1] is not None:
            found[kind] = medians[0], medians[1]
    concerns = _judged(found)
    vehicle = views[0].descriptor.vehicle
    length_m: float | None = figures["ego"]["length_m"]
    wheelbase_m = None if vehicle is None else vehicle.wheelbase_m
    is_longer = wheelbase_m is not None and length_m is not None and wheelbase_m > _LONGER * length_m
    if is_longer and not concerns:
        concerns.append(
            Concern(
                f"The wheelbase that the descriptor declares, {wheelbase_m:g} m, is longer than the ego, "
                f"{length_m:.2f} m: the extents are halves.",
                "Record whole extents: twice what a simulator gives as half extents (CARLA's bounding_box.extent).",
            )
        )
    columns = [
        Column.name("Box"), *map(Column, ("Boxes", "Length, m", "Width, m", "Height, m")),
        Column("Plausible length x width, m", is_text=True),
    ]  # fmt: skip
    return Extents(Table("Sizes of boxes (medians)", columns, rows), concerns, figures)


def _sizes(views: Sequence[ShardView]) -> dict[str, list[np.ndarray[Any, Any]]]:
    """Length, width and height of the boxes of each kind, what is null left out."""
    names = ("length_m", "width_m", "height_m")
    found = {
        "ego": [
            np.concatenate([v.rollouts[f"ego_{name}"][v.rollouts.valid(f"ego_{name}")] for v in views])
            for name in names
        ]
    }
    for kind in ("vehicle", "cycle", "pedestrian", "static"):
        parts = []
        for name in names:
            values = [np.zeros(0, np.float32)]
            for view in views:
                if "actors" in view:
                    stream = view.stream("actors")
                    values.append(stream[name][stream.equals("actor_class", kind) & stream.valid(name)])
            parts.append(np.concatenate(values))
        if len(parts[0]):
            found[kind] = parts
    return found


def _judged(found: Mapping[str, tuple[float, float]]) -> list[Concern]:
    """Concerns of the median length and width of kinds: halves of what is plausible, or another size that is not."""
    concerns, halves = [], []
    for kind, sizes in found.items():
        plausible = _PLAUSIBLE[kind]
        if all(low <= size <= high for size, (low, high) in zip(sizes, plausible, strict=True)):
            continue
        if all(low <= 2 * size <= high for size, (low, high) in zip(sizes, plausible, strict=True)):
            halves.append(f"of {kind} {sizes[0]:.2f} m x {sizes[1]:.2f} m")
            continue
        length, width = (f"{low:g} to {high:g} m" for low, high in plausible)
        concerns.append(
            Concern(
                f"The median box of {kind} is {sizes[0]:.2f} m x {sizes[1]:.2f} m; {length} x {width} is plausible.",
                "Record whole extents in metres, length along the heading.",
                is_problem=kind == "ego",
            )
        )
    if halves:
        concerns.append(
            Concern(
                f"Median boxes are half of what is plausible ({', '.join(halves)}): these are half extents.",
                "Record whole extents, twice the half extents, of the ego and of actors, and measure evidence with "
                "them.",
            )
        )
    return concerns
