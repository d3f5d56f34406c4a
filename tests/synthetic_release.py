"""The raw layer of a small synthetic release: 21 groups on their own routes, with all that a release must explain.

Scenes repeat the three of `tests.scenes` elsewhere and at other speeds. Replays differ a little, in one
training group most; one group is lost at each stage, attempts are retried, cut short and quarantined, one route
is driven by two groups, and one test group repeats the history of a training group in another town.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from tests.content_cache import kept
from tests.scenes import ACTORS, ROUTES
from tests.synthetic import Tables, concat, descriptor, make_group, shared, to_table
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import InventedScene, group_name
from branchdrive.testing.group import by_key
from branchdrive.testing.media import frame_columns, media_document

__all__ = [
    "LOST", "MOVED", "NEAR_DUPLICATE", "NOISY", "NUM_GROUPS", "RELEASE_SHARDS", "SEED", "TWINS", "raw_descriptor",
    "raw_tables",
]  # fmt: skip

NUM_GROUPS = 21
RELEASE_SHARDS = {f"raw/shard-{k:05d}": tuple(range(7 * k, 7 * k + 7)) for k in range(3)}
"""Groups of each shard."""

SEED = 6
"""Seed of the split: with it, training holds all groups that are named below but for those of other partitions."""

DEBUG_CAMERA = "top_down"
"""Camera of the one image of every nominal, at its branch."""

LOST = {"bank": "g3", "controls": "g7", "integrity": "g11", "eligibility": "g15"}
"""The group that is lost at each stage; the last is a training group, and its replays are the noisiest there."""

TWINS = ("g4", "g5")
"""Two training groups on one route."""

NEAR_DUPLICATE = ("g0", "g17")
"""A training group, and a test group that repeats its history elsewhere."""

NOISY = {"g1": 0.02, "g15": 0.04, "g16": 0.06}
"""Groups whose replays start further beside their nominal: the last, of validation, fails the core variables."""

MOVED = "g10"
"""A validation group that fails the extended variables alone: in one attempt, its actors start elsewhere."""


def _scene(index: int) -> InventedScene:
    name = group_name(index)
    if name == NEAR_DUPLICATE[1]:
        model = _scene(int(NEAR_DUPLICATE[0][1:]))
        x, y = model.route.start
        elsewhere = replace(model.route, start=(x, y - 5000.0))
        return replace(model, route=elsewhere, town="Town13", start=(2.0, 0.4, 5.001))
    origin = int(TWINS[0][1:]) if name == TWINS[1] else index
    x, y = ROUTES[origin % 3].start
    return InventedScene(
        replace(ROUTES[origin % 3], start=(x + 1000.0 * origin, y)),
        ACTORS[origin % 3],
        town=("Town12", "Town13")[origin % 2],
        scenario_type=("CutIn", "Crossing", "Junction")[origin // 3 % 3],
        start=(2.0, 0.4, 5.0 + 0.14 * index),
        noise=NOISY.get(name, 0.002),
        moved_m={3: 0.5} if name == MOVED else {},
    )


def _group(index: int) -> Tables:
    return make_group(index, scene=_scene(index))


@cache
def raw_tables() -> dict[str, Tables]:
    """Tables of the raw layer by shard folder; shared by all callers, so never changed in place."""
    return shared(kept("raw-tables", _made_tables))


def _made_tables() -> dict[str, Tables]:
    shards = {folder: concat([_group(index) for index in groups]) for folder, groups in RELEASE_SHARDS.items()}
    for tables in shards.values():
        frames = frame_columns(tables["rollouts"], cameras=[DEBUG_CAMERA], roles=["nominal"], offsets=[0])
        tables["frames"] = to_table("frames", frames)
    d = Draft(shards, raw_descriptor())
    _lose_groups(d)
    _repeat_attempts(d)
    return {folder: {name: by_key(name, table) for name, table in shard.items()} for folder, shard in d.tables.items()}


def _lose_groups(d: Draft) -> None:
    d.drop_attempt(f"{LOST['bank']}.steer_left_0.10.a1")
    d.set("controls", "applied_steer", 0.9, rollout_id=f"{LOST['controls']}.brake_0.50.a1", tick=30)
    d.set("evidence", "separation_m", 1.25, rollout_id=f"{LOST['integrity']}.brake_0.50.a1", tick=100)
    d.set("rollouts", "seed", 99, rollout_id=f"{LOST['eligibility']}.brake_0.50.a1")


def _repeat_attempts(d: Draft) -> None:
    """A duplicate, retries of an attempt that was cut short and of one that broke a rule, and a second nominal."""
    d.copy_attempt("g2.brake_0.50.a1", "g2.brake_0.50.a2", attempt=2)
    d.copy_attempt("g8.brake_0.50.a1", "g8.brake_0.50.a2", attempt=2)
    d.set("rollouts", "status", "partial", rollout_id="g8.brake_0.50.a1")
    d.set("rollouts", "status_reason", "the ego was stuck", rollout_id="g8.brake_0.50.a1")
    d.copy_attempt("g9.brake_0.50.a1", "g9.brake_0.50.a2", attempt=2)
    d.set("controls", "applied_steer", 0.9, rollout_id="g9.brake_0.50.a1", tick=30)
    d.copy_attempt("g10.brake_0.50.a1", "g10.brake_0.50.a2", attempt=2)
    d.set("rollouts", "status", "quarantined", rollout_id="g10.brake_0.50.a2")
    d.set("rollouts", "status_reason", "the server lagged", rollout_id="g10.brake_0.50.a2")
    d.copy_attempt("g12.nominal.a1", "g12.nominal.a2", attempt=2, trigger_rollout_id="g12.nominal.a2")
    d.copy_attempt("g12.brake_0.50.a1", "g12.brake_0.50.a2", attempt=2)
    d.set("rollouts", ("nominal_rollout_id", "trigger_rollout_id"), "g12.nominal.a2", rollout_id="g12.brake_0.50.a2")


def raw_descriptor() -> dict[str, Any]:
    """Descriptor of the raw layer, a fresh copy."""
    return {
        **media_document(descriptor(), "rgb_top_down"),
        "dataset_id": "synthetic-release",
        "title": "A small valid release",
    }
