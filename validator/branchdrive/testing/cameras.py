"""Cameras of a descriptor: a Hypothesis strategy read from its schema."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hypothesis import strategies as st

from branchdrive.contract.columns import STREAMS
from branchdrive.contract.resources import load_resource
from branchdrive.testing.conforming import conforming

if TYPE_CHECKING:
    from hypothesis.strategies import DrawFn

__all__ = ["camera_lists"]


@st.composite
def camera_lists(draw: DrawFn, streams: Sequence[str]) -> list[dict[str, Any]]:
    """Cameras that the media streams among `streams` need, and up to two more of them, as documents in any order."""
    stream_of = {camera: name for name in streams for camera in STREAMS[name].cameras}
    if not stream_of:
        return []
    nodes = [load_resource("descriptor.schema.json")["$defs"][f"{kind}_camera"] for kind in ("pinhole", "top_down")]
    others = draw(st.sets(conforming(nodes[0]["properties"]["name"]), max_size=2)) - set(stream_of)
    stream_of |= {name: draw(st.sampled_from(sorted(set(stream_of.values())))) for name in sorted(others)}
    cameras = []
    for name, stream in sorted(stream_of.items()):
        of_stream = [node for node in nodes if stream in node["properties"]["stream"]["enum"]]
        fixed = {"name": st.just(name), "stream": st.just(stream)}
        cameras.append(draw(conforming(draw(st.sampled_from(of_stream)), **fixed)))
    return list(draw(st.permutations(cameras)))
