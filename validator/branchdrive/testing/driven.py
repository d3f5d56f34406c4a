"""Hypothesis strategies for small valid datasets: scenes, banks that a car can drive, and what comes of both.

Numbers are drawn in tenths or hundredths, so that an example is easy to read, and from ranges in which the invented
car drives as the rules on motion demand.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter, itemgetter

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.policy import ActuatorRule, Policy
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS
from branchdrive.testing.dataset import SmallDataset
from branchdrive.testing.drive import (
    BRANCH_TICK,
    CAR_M,
    CONE_M,
    CYCLE_M,
    NUM_TICKS,
    PERSON_M,
    Actor,
    Route,
    Scene,
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

_FAMILIES = ("accelerate", "brake", "steer_left", "steer_right")
_BOXES_M = {"vehicle": CAR_M, "cycle": CYCLE_M, "pedestrian": PERSON_M, "static": CONE_M}
_MAX_SPEEDS_MPS = {"vehicle": 9, "cycle": 6, "pedestrian": 0, "static": 0}


def _fractions(low: int, high: int, parts: int) -> SearchStrategy[float]:
    """Numbers ``low / parts .. high / parts``."""
    return st.integers(low, high).map(lambda number: number / parts)


@st.composite
def _actors(draw: DrawFn) -> Actor:
    kind = draw(st.sampled_from(tuple(_BOXES_M)))
    fastest = _MAX_SPEEDS_MPS[kind]
    return Actor(
        kind,
        _BOXES_M[kind],
        progress_m=draw(_fractions(0, 1200, 10)),
        offset_m=draw(_fractions(-80, 80, 10)),
        speed_mps=float(draw(st.integers(-fastest, fastest))),
        lateral_mps=draw(_fractions(-10, 10, 10)) if kind == "pedestrian" else 0.0,
        first_tick=OBSERVATION_STRIDE_TICKS * draw(st.integers(0, 10)),
    )


@st.composite
def scenes(draw: DrawFn, *, max_actors: int = 3) -> Scene:
    """A straight or bent route, an ego that starts on it, and up to `max_actors` actors beside it."""
    start = draw(st.tuples(_fractions(-500, 500, 1), _fractions(-500, 500, 1)))
    bend = draw(st.sampled_from([{}, {"radius_m": 120.0}, {"radius_m": 300.0}]))
    actors = draw(st.lists(_actors(), max_size=max_actors, unique_by=attrgetter("progress_m", "offset_m")))
    return Scene(
        Route(start, draw(_fractions(-31, 31, 10)), **bend),
        tuple(actors),
        town=draw(st.sampled_from(["Town01", "Town02"])),
        scenario_type=draw(st.sampled_from(["CutIn", "Crossing"])),
        start=(2.0, draw(_fractions(-5, 5, 10)), draw(_fractions(500, 800, 100))),
    )


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
    branch_tick = BRANCH_TICK + OBSERVATION_STRIDE_TICKS * draw(st.integers(0, 4))
    shortest = branch_tick + ACTIVE_TICKS + 1
    return SmallDataset(
        tuple(group_scenes),
        draw(driven_banks() if bank is None else bank),
        branch_tick,
        num_ticks=draw(st.integers(shortest, max(NUM_TICKS, shortest))),
        groups_per_shard=draw(st.integers(1, max_groups)),
        streams=draw(st.sampled_from(streams)),
    )
