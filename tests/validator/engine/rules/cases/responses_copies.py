"""Defects and limits of groups that repeat each other."""

from __future__ import annotations

from dataclasses import replace

import pyarrow as pa
from tests.scenes import SCENES
from tests.synthetic import make_group
from tests.validator.engine.rules.case import NOMINAL, REPLAY, boundary, mutant
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import Route

# BD-RSP-005


@mutant("BD-RSP-005", base="bare", at={"group_id": "g9"})
def group_under_two_names(d: Draft) -> None:
    for row in d.take("rollouts", group_id="g0").to_pylist():
        renamed = {
            name: f"g9{value[2:]}"
            for name in ("nominal_rollout_id", "trigger_rollout_id")
            if (value := row[name]) is not None
        }
        d.copy_attempt(row["rollout_id"], f"g9{row['rollout_id'][2:]}", group_id="g9", **renamed)


@boundary("BD-RSP-005", base="bare")
def replay_that_repeats_its_nominal(d: Draft) -> None:
    """Replays of a world without noise are equal to their nominal: that is what they are for."""
    for shard in d.tables.values():
        rows = shard["observations"].to_pylist()
        nominal = {row["tick"]: row for row in rows if row["rollout_id"] == NOMINAL}
        for i, row in enumerate(rows):
            if row["rollout_id"] == REPLAY:
                rows[i] = {**nominal[row["tick"]], "rollout_id": REPLAY}
        shard["observations"] = pa.Table.from_pylist(rows, shard["observations"].schema)


# BD-RSP-015


def _drive_again(d: Draft, speed_mps: float) -> None:
    """Let the third group drive like the first one, with its actors, in another town and direction."""
    scene = replace(SCENES[0], route=Route((700.0, 300.0), 1.0), town="Town13", start=(2.0, 0.4, speed_mps))
    d.replace_group(2, make_group(2, scene=scene))


@mutant("BD-RSP-015", at={"group_id": "g2"})
def group_in_another_place(d: Draft) -> None:
    _drive_again(d, 6.0)


@mutant("BD-RSP-015", at={"group_id": "g2"})
def group_in_another_place_with_noise(d: Draft) -> None:
    _drive_again(d, 6.001)


@boundary("BD-RSP-015")
def group_with_another_speed_in_the_same_scene(d: Draft) -> None:
    _drive_again(d, 5.5)
