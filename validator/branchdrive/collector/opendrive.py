"""A map from an ASAM OpenDRIVE file: lanes, shoulders, parking strips, signals, stop lines and crossings.

What has no row in a map is left out: links, elevation, lane borders and other marks, junction areas, signals of other
roads by reference, repeated objects.

Source: ASAM OpenDRIVE 1.8, chapters 9 to 14; spec/05-raw-streams.md#map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from branchdrive.collector.opendrive_road import MOST_VERTICES, Road
from branchdrive.errors import UsageError

__all__ = ["read_opendrive"]

MOST_BYTES = 256 << 20
"""Of a file."""


def read_opendrive(path: str | Path, *, step_m: float = 1.0) -> list[dict[str, Any]]:
    """Elements of the map of a town from an OpenDRIVE file (1.4 to 1.8).

    Lanes run in driving order, by the side of the road that is driven on and by the direction of the lane. A lane is
    cut where its section or its speed limit ends, and is called ``ROAD.SECTION.LANE``. Places are those of the file:
    neither its geo-reference nor its offset is applied.

    Args:
        path: The file.
        step_m: Largest distance of vertices along a road that bends, metres; straight pieces have two.

    Returns:
        Elements, as `World` takes them for a town.

    Raises:
        UsageError: The file cannot be read, is no OpenDRIVE, says something impossible, or is too large.
    """
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{str(path)!r}: {error.strerror}") from error
    if len(content) > MOST_BYTES:
        raise UsageError(f"{str(path)!r} has more than {MOST_BYTES} bytes; split the map")
    if b"<!DOCTYPE" in content or b"\0" in content:
        raise UsageError(
            f"{str(path)!r} declares a document type, or is not UTF-8; remove the declaration, or convert it"
        )
    try:
        document = ElementTree.fromstring(content)  # noqa: S314 - it has no entities
    except ElementTree.ParseError as error:
        raise UsageError(f"{str(path)!r} is no XML: {error}") from error
    found: list[dict[str, Any]] = []
    left = MOST_VERTICES
    try:
        for road in document.findall("road"):
            for element in Road(road, step_m).elements():
                left -= len(element["x_m"])
                if left < 0:
                    raise UsageError(f"the map has more than {MOST_VERTICES} vertices; choose a larger step_m")
                found.append(element)
    except UsageError as error:
        raise UsageError(f"{str(path)!r}: {error}") from None
    if not any(element["kind"] == "lane" for element in found):
        raise UsageError(f"{str(path)!r} has no lane that motor vehicles may drive; is it OpenDRIVE?")
    return found
