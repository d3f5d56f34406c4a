"""Defects and limits of what images show of responses."""

from __future__ import annotations

from dataclasses import replace

import pyarrow as pa
from tests.scenes import SCENES
from tests.synthetic import STRIDE, make_group
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.replays import repeat_exactly
from tests.validator.engine.rules.draft import Draft

# BD-RSP-014


def _drive(d: Draft) -> None:
    """Let every replay repeat the drive of its nominal to the bit until the branch, in three more groups too."""
    repeat_exactly(d)
    for index, scene in enumerate(SCENES):
        offset_m, speed_mps = scene.start[1] - 0.2, scene.start[2] + 0.5
        other = make_group(index + 3, scene=replace(scene, noise=0.0, start=(2.0, offset_m, speed_mps)))
        folder = d.folder_of(f"g{index}.nominal.a1")
        for table, rows in other.items():
            d.append(table, rows, folder=folder)
        rows = [
            {**row, "rollout_id": f"g{index + 3}{row['rollout_id'][2:]}"}
            for row in d.tables[folder]["frames"].to_pylist()
            if row["rollout_id"].startswith(f"g{index}.") and row["rollout_id"] != "g1.brake_0.50.a2"
        ]
        d.append("frames", pa.Table.from_pylist(rows, d.tables[folder]["frames"].schema), folder=folder)


ALL = ("g0", "g1", "g2", "g3", "g4", "g5")


def _show_late(d: Draft, groups: tuple[str, ...], cameras: tuple[str, ...] | None = None) -> None:
    """Give every image of groups, or of some of their cameras, the bytes of the one before."""
    for shard in d.tables.values():
        group = {row["rollout_id"]: row["group_id"] for row in shard["rollouts"].to_pylist()}
        rows = shard["frames"].to_pylist()
        content = {(row["rollout_id"], row["camera"], row["tick"]): row for row in rows}
        for i, row in enumerate(rows):
            before = content.get((row["rollout_id"], row["camera"], row["tick"] - STRIDE))
            is_late = group[row["rollout_id"]] in groups and (cameras is None or row["camera"] in cameras)
            if before is not None and is_late:
                rows[i] = {**row, "offset_bytes": before["offset_bytes"], "checksum": before["checksum"]}
        shard["frames"] = pa.Table.from_pylist(rows, shard["frames"].schema)


@mutant("BD-RSP-014", base="media", at={"camera": "front"}, findings=6)
def images_that_are_an_observation_late(d: Draft) -> None:
    _drive(d)
    _show_late(d, ALL)


@mutant("BD-RSP-014", base="media", at={"camera": "rear"})
def one_camera_that_is_an_observation_late(d: Draft) -> None:
    _drive(d)
    _show_late(d, ALL, ("rear",))


@boundary("BD-RSP-014", base="media")
def images_that_show_the_first_response(d: Draft) -> None:
    _drive(d)
