"""Hypothesis strategies for small valid datasets: scenes, banks that a car can drive, and what comes of both.

Numbers are drawn in tenths or hundredths, so that an example is easy to read, and from ranges in which the invented
car drives as the rules on motion demand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter, itemgetter

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from branchdrive.contract.bank import ActionBank, load_action_bank
from branchdrive.contract.policy import ActuatorRule, Policy
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.box import Boxes, box_gap
from branchdrive.testing.dataset import SmallDataset
from branchdrive.testing.drive import (
    BRANCH_TICK,
    CAR_M,
    CONE_M,
    CYCLE_M,
    EGO_BOX_M,
    NUM_TICKS,
    PERSON_M,
    TICK_S,
    InventedActor,
    InventedScene,
    Route,
    drive,
    plans,
)

__all__ = ["OPTIONAL_STREAMS", "datasets", "driven_banks", "scenes"]

OPTIONAL_STREAMS: tuple[tuple[str, ...], ...] = (
    (),
    ("actor_risk_evidence",),
    ("actor_risk_evidence", "rgb_surround"),
    ("actor_risk_evidence", "map"),
    ("actor_risk_evidence", "rgb_surround", "map"),
)
"""Streams that datasets claim beside the required ones."""

_LAST_BRANCH_TICK = BRANCH_TICK + 4 * OBSERVATION_STRIDE_TICKS

_APART_M = 0.1
"""Replays start a few centimetres beside their nominal, and touch what it only passes."""

_FAMILIES = ("accelerate", "brake", "steer_left", "steer_right")
_BOXES_M = {"vehicle": CAR_M, "cycle": CYCLE_M, "pedestrian": PERSON_M, "static": CONE_M}
_MAX_SPEEDS_MPS = {"vehicle": 9, "cycle": 6, "pedestrian": 0, "static": 0}


def _fractions(low: int, high: int, parts: int) -> SearchStrategy[float]:
    """Numbers ``low / parts .. high / parts``."""
    return st.integers(low, high).map(lambda number: number / parts)


@st.composite
def _actors(draw: DrawFn) -> InventedActor:
    kind = draw(st.sampled_from(tuple(_BOXES_M)))
    fastest = _MAX_SPEEDS_MPS[kind]
    return InventedActor(
        kind,
        _BOXES_M[kind],
        progress_m=draw(_fractions(0, 1200, 10)),
        offset_m=draw(_fractions(-80, 80, 10)),
        speed_mps=float(draw(st.integers(-fastest, fastest))),
        lateral_mps=draw(_fractions(-10, 10, 10)) if kind == "pedestrian" else 0.0,
        first_tick=OBSERVATION_STRIDE_TICKS * draw(st.integers(0, 10)),
    )


@st.composite
def scenes(draw: DrawFn, *, max_actors: int = 3) -> InventedScene:
    """A straight or bent route, an ego that starts on it, and up to `max_actors` actors that it meets late or never."""
    start = draw(st.tuples(_fractions(-500, 500, 1), _fractions(-500, 500, 1)))
    bend = draw(st.sampled_from([{}, {"radius_m": 120.0}, {"radius_m": 300.0}]))
    scene = InventedScene(
        Route(start, draw(_fractions(-31, 31, 10)), **bend),
        (),
        town=draw(st.sampled_from(["Town01", "Town02"])),
        scenario_type=draw(st.sampled_from(["CutIn", "Crossing"])),
        start=(2.0, draw(_fractions(-5, 5, 10)), draw(_fractions(500, 800, 100))),
    )
    actors = draw(st.lists(_actors(), max_size=max_actors, unique_by=attrgetter("progress_m", "offset_m")))
    return replace(scene, actors=tuple(actor for actor in actors if not _is_met_early(scene, actor)))


def _is_met_early(scene: InventedScene, actor: InventedActor) -> bool:
    """Whether the ego comes within `_APART_M` of an actor before it branches, wherever that is in a dataset."""
    ticks = np.arange(_LAST_BRANCH_TICK + 1)
    ego = drive(scene, plans(0)[:1], load_action_bank(), len(ticks))
    along_m, across_m = (speed * ticks * TICK_S for speed in (actor.speed_mps, actor.lateral_mps))
    at = scene.route.point(actor.progress_m + along_m, actor.offset_m + across_m)
    boxes = (
        Boxes(*pose, *(np.full(len(ticks), size) for size in box_m[:2]))
        for pose, box_m in (((ego.x_m[:, 0], ego.y_m[:, 0], ego.yaw_rad[:, 0]), EGO_BOX_M), (at, actor.box_m))
    )
    return bool((box_gap(*boxes).gap_m < _APART_M).any())


@st.composite
def _policies(draw: DrawFn, key: str) -> Policy:
    """A policy whose commands stay inside the ranges of the columns, whatever the expert demands."""
    steering = _fractions(-8, 8, 100).filter(bool)
    steer = st.sampled_from(["online_expert", "zero"]) | st.tuples(st.just("absolute"), steering)
    pedal = st.sampled_from(["online_expert", "zero", "stored_nominal"]) | st.tuples(
        st.just("floor"), _fractions(1, 8, 10)
    )
    rules = []
    for drawn in (draw(steer), draw(pedal), draw(pedal)):
        rule, value = (drawn, None) if isinstance(drawn, str) else drawn
        rules.append(ActuatorRule.model_validate({"rule": rule, "value": value}))
    return Policy(
        key=key,
        family=draw(st.sampled_from(_FAMILIES)),
        magnitude=draw(_fractions(1, 10, 10)),
        duration_ticks=ACTIVE_TICKS,
        recovery="online_expert",
        steer=rules[0],
        throttle=rules[1],
        brake=rules[2],
    )


@st.composite
def driven_banks(draw: DrawFn, *, max_interventions: int = 3) -> ActionBank:
    """Banks of the nominal policy and up to `max_interventions` others, each of the length that the protocol asks."""
    left_alone = ActuatorRule(rule="online_expert", value=None)
    nominal = Policy(
        key="nominal", family="nominal", magnitude=0.0, duration_ticks=0, recovery="none",
        steer=left_alone, throttle=left_alone, brake=left_alone,
    )  # fmt: skip
    count = draw(st.integers(1, max_interventions))
    interventions = [draw(_policies(f"policy_{number}")) for number in range(1, count + 1)]
    return ActionBank(name="generated", policies=(nominal, *interventions))


@st.composite
def datasets(
    draw: DrawFn,
    *,
    bank: SearchStrategy[ActionBank] | None = None,
    streams: Sequence[tuple[str, ...]] = OPTIONAL_STREAMS,
    min_groups: int = 1,
    max_groups: int = 2,
    max_actors: int = 3,
) -> SmallDataset:
    """Valid datasets of a raw layer, no rule of which fails.

    Args:
        draw: Given by Hypothesis.
        bank: Banks that groups drive; `driven_banks` by default.
        streams: Choices of optional streams.
        min_groups: Least number of groups.
        max_groups: Largest number of groups.
        max_actors: Most actors beside the ego.
    """
    group_scenes = draw(
        st.lists(
            scenes(max_actors=max_actors), min_size=min_groups, max_size=max_groups,
            unique_by=(attrgetter("route.start"), lambda scene: itemgetter(2)(scene.start)),
        )
    )  # fmt: skip
    branch_tick = draw(st.sampled_from(range(BRANCH_TICK, _LAST_BRANCH_TICK + 1, OBSERVATION_STRIDE_TICKS)))
    shortest = branch_tick + ACTIVE_TICKS + 1
    return SmallDataset(
        tuple(group_scenes),
        draw(driven_banks() if bank is None else bank),
        branch_tick,
        num_ticks=draw(st.integers(shortest, max(NUM_TICKS, shortest))),
        groups_per_shard=draw(st.integers(1, max_groups)),
        streams=draw(st.sampled_from(streams)),
    )
