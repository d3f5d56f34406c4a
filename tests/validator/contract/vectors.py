"""Vectors of `schemas/v0.1/vectors/` for readers of any language, by second implementations.

Risk evidence comes from the oracle with shapely, projections from their definition point by point, the encoding from
its definition by index, digests from hashlib over the lines and bytes that the chapters spell out.
``python -m tests.validator.contract.vectors`` writes the files; a test compares them with this text and the library
with them.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

from tests.synthetic_map import map_tables
from tests.validator.contract.test_encoding import vector_by_index
from tests.validator.driving.oracle import Actor, Ego, closing_mps, evidence
from tests.validator.raw.spelled_content import group_blocks, lines_digest, sha, table_block

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.columns import LAYER_TABLES, TABLES, declared_table
from branchdrive.contract.resources import schema_dir

FOLDER = schema_dir() / "vectors"
_ROUTE = [(-20.0, 0.0), (100.0, 0.0)]
_SCENES: dict[str, tuple[Ego, list[Actor]]] = {
    "nobody": (Ego(speed_mps=10.0), []),
    "a slower vehicle ahead": (Ego(speed_mps=10.0), [Actor(3, "vehicle", 20.0, 0.0, vel_x_mps=4.0)]),
    "a faster vehicle ahead, which opens the gap": (
        Ego(speed_mps=4.0), [Actor(3, "vehicle", 20.0, 0.0, vel_x_mps=10.0)],
    ),
    "a gap that closes at less than 0.1 m/s": (
        Ego(speed_mps=10.0), [Actor(3, "vehicle", 20.0, 0.0, vel_x_mps=9.95)],
    ),
    "parallel edges, closest points not unique": (
        Ego(speed_mps=3.0), [Actor(1, "vehicle", 0.5, 4.0, vel_x_mps=3.0, vel_y_mps=-0.5)],
    ),
    "corner to corner": (Ego(speed_mps=5.0), [Actor(1, "cycle", 7.0, 5.0, length_m=2.0, width_m=1.0)]),
    "a crossing vehicle, turned": (
        Ego(yaw_rad=0.3, speed_mps=8.0), [Actor(9, "vehicle", 15.0, -6.0, 1.9, 4.5, 1.8, -0.5, 6.0)],
    ),
    "overlap": (
        Ego(speed_mps=8.0), [Actor(5, "vehicle", 3.0, 0.5, 0.4), Actor(4, "pedestrian", 12.0, 0.0, 0.0, 0.5, 0.5)],
    ),
    "edges that touch": (Ego(speed_mps=8.0), [Actor(5, "vehicle", 4.0, 0.0)]),
    "just within range and just out of it": (
        Ego(speed_mps=20.0), [Actor(1, "vehicle", 53.99, 0.0), Actor(2, "pedestrian", 0.0, 52.01, 0.0, 0.5, 2.0)],
    ),
    "static objects in the corridor and beside it": (
        Ego(speed_mps=10.0),
        [Actor(1, "static", 30.0, 1.9, 0.0, 1.0, 1.0), Actor(2, "static", 10.0, 2.6, 0.0, 1.0, 1.0)],
    ),
    "equal gaps": (
        Ego(speed_mps=0.0), [Actor(8, "vehicle", 0.0, 6.0), Actor(7, "vehicle", 0.0, -6.0)],
    ),
    "one at a time of each class": (
        Ego(yaw_rad=-2.5, speed_mps=12.0),
        [
            Actor(1, "vehicle", -20.0, -12.0, -2.2, 4.6, 1.9, -2.0, -1.0),
            Actor(2, "cycle", -8.0, -9.0, 0.7, 1.8, 0.6, 1.0, 2.0),
            Actor(3, "pedestrian", -14.0, -3.0, 0.0, 0.5, 0.5, 0.0, -1.4),
            Actor(4, "static", -12.0, -12.0, 0.0, 0.8, 0.8),
        ],
    ),
}  # fmt: skip


def risk_vectors() -> dict[str, Any]:
    """Gap, closing speed and evidence of single observations."""
    return {
        "about": "Gaps, closing speeds and evidence of spec/05-raw-streams.md#evidence; they agree to 1e-9.",
        "route_x_m": [x for x, _ in _ROUTE],
        "route_y_m": [y for _, y in _ROUTE],
        "scenes": [
            {
                "title": title,
                "ego": asdict(ego),
                "actors": [
                    {
                        **asdict(actor),
                        "gap_m": _rounded(ego.polygon.distance(actor.polygon)),
                        "closing_mps": _rounded(closing_mps(ego, actor)),
                    }
                    for actor in actors
                ],
                "evidence": _row(evidence(ego, actors, _ROUTE)),
            }
            for title, (ego, actors) in _SCENES.items()
        ],
    }


def _row(found: dict[str, Any]) -> dict[str, Any]:
    """Evidence by the names of the columns; null where unavailable."""
    row = {
        "num_actors": found["num_actors"],
        "separation_m": found["separation"][0],
        "separation_actor_id": found["separation"][1],
        "ttc_s": found["ttc"][0],
        "ttc_actor_id": found["ttc"][1],
        "nearest_vehicle_gap_m": found["nearest_vehicle"][0],
        "nearest_vehicle_rel_speed_mps": found["nearest_vehicle"][2],
        "nearest_pedestrian_gap_m": found["nearest_pedestrian"][0],
    }
    return {column: _rounded(value) if isinstance(value, float) else value for column, value in row.items()}


def _rounded(value: float) -> float:
    """Without the last bits, in which libraries of geometry differ."""
    return round(value, 11) + 0.0


def encoding_vectors() -> dict[str, Any]:
    """Every policy of the reference bank as `bd29`, its floats by their bits, and digests of matrices."""
    policies = load_action_bank().policies
    rows = {
        policy.key: [struct.unpack("<f", struct.pack("<f", c))[0] for c in vector_by_index(policy)]
        for policy in policies
    }
    packed = {key: b"".join(struct.pack("<f", component) for component in row) for key, row in rows.items()}
    return {
        "about": "The encoding bd29 of spec/04-policies.md#encoding: float32 values, exact in decimal digits.",
        "policies": [{"policy": policy.model_dump(mode="json"), "vector": rows[policy.key]} for policy in policies],
        "matrices": [
            {"keys": list(keys), "sha256": hashlib.sha256(b"".join(packed[key] for key in keys)).hexdigest()}
            for keys in (tuple(rows), tuple(reversed(rows)), ("nominal", "brake_0.50"))
        ],
    }


_POLYLINES: dict[str, tuple[list[tuple[float, float]], list[tuple[float, float]]]] = {
    "two vertices": (
        [(0.0, 0.0), (100.0, 0.0)],
        [(50.0, 2.5), (50.0, -2.5), (50.0, 0.0), (0.0, 0.0), (100.0, 0.0), (-3.0, 4.0), (103.0, -4.0), (-3.0, 0.0)],
    ),
    "a corner to the left: equally near segments, and the vertex from both sides": (
        [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)],
        [(7.0, 3.0), (10.0, 0.0), (13.0, -4.0), (11.0, -1.0), (10.0, 20.0)],
    ),
    "a corner to the right, and a segment that leads back": (
        [(-8.0, 6.0), (0.0, 0.0), (-8.0, -6.0), (-8.0, 0.0)],
        [(-4.0, 1.0), (2.0, 0.0), (-8.0, 0.5), (-9.0, -3.0)],
    ),
    "a route that crosses itself": (
        [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 10.0), (5.0, -10.0)],
        [(5.0, 0.0), (5.0, 0.25), (5.25, 0.0), (5.0, -1.0), (7.5, 5.0)],
    ),
    "an arc of 40 vertices": (
        [(round(50 * math.sin(0.05 * i), 3), round(50 - 50 * math.cos(0.05 * i), 3)) for i in range(40)],
        [(0.0, 0.0), (20.0, 3.0), (45.0, 31.0), (0.0, 50.0), (60.0, 70.0), (46.5, 68.9)],
    ),
}


def projection_vectors() -> dict[str, Any]:
    """Polylines with points, and where each lies: progress, offset and heading."""
    return {
        "about": "Position of points on a polyline as spec/05-raw-streams.md#projection has it; agreement within 1e-9. "
        "Points before, behind, on and between vertices, equally near feet, and a route that crosses itself.",
        "polylines": [
            {
                "title": title,
                "x_m": [x for x, _ in line],
                "y_m": [y for _, y in line],
                "points": [{"x_m": x, "y_m": y, **_projected(x, y, line)} for x, y in points],
            }
            for title, (line, points) in _POLYLINES.items()
        ],
    }


def _projected(x: float, y: float, line: list[tuple[float, float]]) -> dict[str, float]:
    """The nearest foot, segment by segment; of equally near ones the first."""
    best, arc = (math.inf, {}), 0.0
    for (ax, ay), (bx, by) in pairwise(line):
        ex, ey, px, py = bx - ax, by - ay, x - ax, y - ay
        share = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        distance, length = math.dist((px, py), (share * ex, share * ey)), math.hypot(ex, ey)
        if distance < best[0] - 1e-12:
            side = -1.0 if ex * py - ey * px < 0 else 1.0
            found = {
                "progress_m": _rounded(arc + share * length),
                "offset_m": _rounded(side * distance),
                "heading_rad": _rounded(math.atan2(ey, ex)),
            }
            best = distance, found
        arc += length
    return best[1]


_FILES = {
    "README.md": "# Card\n",
    "branchdrive.json": '{"spec_version": "0.1"}\n',
    "canonical/source.json": "{}\n",
    "model/features.json": "[]\n",
    "raw/shard-00000/controls.parquet": "not a table\n",
    "raw/shard-00000/frames.parquet": "media index\n",
    "raw/shard-00000/media.tar": "",
    "raw/shard-00000/rollouts.parquet": "grüße\n",
    "raw/shard-00001/rollouts.parquet": "other\n",
}
_MEDIA = ("raw/shard-00000/frames.parquet", "raw/shard-00000/media.tar")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def digest_vectors() -> dict[str, Any]:
    """Digests of files, layers, identity, split and population, with the lines that they are taken of."""
    line = {path: f"{_sha256(content)}  {path}\n" for path, content in sorted(_FILES.items())}
    owner = {path: "media" if path in _MEDIA else path.split("/")[0] for path in line if "/" in path}
    names = [name for name in ("raw", "canonical", "quality", "model", "benchmark", "media") if name in owner.values()]
    layers = {name: _sha256("".join(line[path] for path in line if owner.get(path) == name)) for name in names}
    covered = [f"layer {name} {digest}\n" for name, digest in layers.items() if name in ("raw", "canonical", "model")]
    identity = _sha256("".join(covered))
    head = ["# branchdrive-manifest 0.1\n", *(f"# layer {name} {digest}\n" for name, digest in layers.items())]
    partitions = {"g-10": "train", "g-2": "test", "G1": "val", "g-1": "train"}
    return {
        "about": "Digests of spec/03-layout.md#identity, 10-layers.md#variants and 11-fidelity.md#split-digest.",
        "files": [{"path": path, "text": text, "sha256": _sha256(text)} for path, text in _FILES.items()],
        "layers": layers,
        "identity": identity,
        "manifest": "".join([*head, f"# dataset {identity}\n", *line.values()]),
        "split": {
            "partitions": partitions,
            "sha256": _sha256("".join(sorted(f"{group}\t{name}\n" for group, name in partitions.items()))),
        },
        "population": {
            "groups": list(partitions),
            "sha256": _sha256("".join(f"{group}\n" for group in sorted(partitions))),
        },
    }


_GROUP = "g0"
_ATTEMPTS = ("g0.nominal.a1", "g0.brake_0.50.a1")
_TICKS = range(6)
"""Ticks that the dataset of `content_vectors` keeps, so that people can look through it."""

_CANONICAL: dict[str, Any] = {
    "source.json": {"spec_version": "0.1", "raw_layer": None, "num_groups": 1, "share": 0.1, "tiny": -2.5e-7,
                    "large": 1e300, "nothing": [], "text": "gr\u00fc\u00dfe", "flags": {"b": True, "a": False}},
}  # fmt: skip


def content_vectors() -> dict[str, Any]:
    """One group with rows of every table, and the digest of everything that the content of a dataset is made of."""
    rows = {name: _rows_of(name) for name in TABLES if name not in ("frames", "decisions")}
    blocks = group_blocks(_GROUP, rows)
    group = sha(b"".join(blocks.values())).hex()
    towns = {f"map {town}": table_block("map", rows["map"]).hex() for town in sorted({r["town"] for r in rows["map"]})}
    raw = lines_digest({f"group {_GROUP}": group, **towns})
    records = [_record(row) for row in rows["rollouts"]]
    document = {**_CANONICAL["source.json"], "raw_layer": raw}
    parts = {
        "canonical/attempts-00000.parquet": table_block("attempts", records).hex(),
        "canonical/source.json": sha(_spelled_document(document)).hex(),
    }
    canonical = lines_digest(parts)
    text = json.dumps({"dataset_id": "vectors", "layers": ["raw", "canonical"]}, indent=2) + "\n"
    return {
        "about": "Content digests of spec/03-layout.md#content on one branch group, cut to a few ticks and two "
        "attempts, so no valid dataset. A row is a list in the order of `columns`; float32 columns hold the doubles "
        "that are equal to them. `block` is the digest of all rows of a table, and `blocks` are those of a group.",
        "descriptor": {"text": text, "sha256": _sha256(text)},
        "tables": {
            **{name: _table(name, found) for name, found in rows.items()},
            "attempts": _table("attempts", records),
        },
        "groups": {_GROUP: {"blocks": {name: digest.hex() for name, digest in blocks.items()}, "sha256": group}},
        "maps": towns,
        "documents": {"canonical/source.json": {"value": document, "sha256": parts["canonical/source.json"]}},
        "parts": parts,
        "layers": {"raw": raw, "canonical": canonical},
        "identity": _sha256(f"layer raw {raw}\nlayer canonical {canonical}\n"),
    }


def _rows_of(name: str) -> list[dict[str, Any]]:
    (rows,) = [
        shard[name].to_pylist()
        for shard in map_tables().values()
        if _GROUP in shard["rollouts"]["group_id"].to_pylist()
    ]
    if name == "map":
        town = next(row["town"] for row in _rows_of("rollouts"))
        return [row for row in rows if row["town"] == town and row["element_id"].startswith("far-")]
    rows = [row for row in rows if row["rollout_id"] in _ATTEMPTS and row.get("tick", 0) in _TICKS]
    if name == "rollouts":
        rows = [{**row, "route_x_m": row["route_x_m"][:3], "route_y_m": row["route_y_m"][:3]} for row in rows]
    if name == "controls":
        rows[0]["applied_brake"] = -0.0
    return rows


def _record(row: dict[str, Any]) -> dict[str, Any]:
    return {
        **{column.name: row.get(column.name) for column in LAYER_TABLES["attempts"].columns},
        "disposition": "selected",
    }


def _table(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    columns = declared_table(name).columns
    return {
        "columns": [{"name": c.name, "type": c.type, "may_be_null": c.nullable} for c in columns],
        "key": list(declared_table(name).key),
        "rows": [[row[column.name] for column in columns] for row in rows],
        "block": table_block(name, rows).hex(),
    }


def _spelled_document(value: Any) -> bytes:
    """The value of a document in the bytes that chapter 3 spells."""
    match value:
        case None | bool():
            return {None: b"n", True: b"t", False: b"f"}[value]
        case int() | float() if float(value).is_integer():
            return b"i%d;" % int(value)
        case float():
            return b"d%b;" % value.hex().encode()
        case str():
            return b"s%d:%b" % (len(value.encode()), value.encode())
        case list():
            return b"a%d:%b" % (len(value), b"".join(map(_spelled_document, value)))
        case _:
            members = sorted(value.items(), key=lambda member: member[0].encode())
            pieces = (_spelled_document(key) + _spelled_document(member) for key, member in members)
            return b"o%d:%b" % (len(value), b"".join(pieces))


VECTORS = {
    "risk.json": risk_vectors,
    "projection.json": projection_vectors,
    "encoding.json": encoding_vectors,
    "digests.json": digest_vectors,
    "content.json": content_vectors,
}
"""Functions of the vectors by file name."""


def text(name: str) -> str:
    """Vectors as the file `name` has them."""
    return json.dumps(VECTORS[name](), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


if __name__ == "__main__":
    for file_name in VECTORS:
        (Path(FOLDER) / file_name).write_text(text(file_name), encoding="utf-8")
