"""Defects and limits of risk evidence: values, masks, actors, and pairs that lie exactly on a cut-off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tests.validator.engine.rules.case import (
    BOTH,
    BRAKE,
    FURTHER,
    boundary,
    mutant,
)
from tests.validator.engine.rules.draft import Draft

from branchdrive.testing.drive import BRANCH_TICK, CONE_M, EGO_BOX_M

G2_NOMINAL = "g2.nominal.a1"


TOLERANCE = 1e-6


OUTSIDE_TICK = BRANCH_TICK + 55


SCENE_TICK = 5


ABSENT: dict[str, Any] = {
    "separation_available": False, "separation_m": None, "separation_actor_id": None,
    "ttc_available": False, "ttc_s": None, "ttc_actor_id": None,
    "nearest_vehicle_available": False, "nearest_vehicle_gap_m": None, "nearest_vehicle_rel_speed_mps": None,
    "nearest_pedestrian_available": False, "nearest_pedestrian_gap_m": None,
}  # fmt: skip


def _place(column: str, tick: int = BRANCH_TICK, rollout_id: str = BRAKE) -> dict[str, str | int]:
    return {"table": "evidence", "column": column, "rollout_id": rollout_id, "tick": tick}


def _state(d: Draft, tick: int = BRANCH_TICK, rollout_id: str = BRAKE, **columns: Any) -> None:
    for column, value in columns.items():
        d.set("evidence", column, value, rollout_id=rollout_id, tick=tick)


# BD-EVD-001


@mutant("BD-EVD-001", at=_place("separation_m"))
def separation_between_centres(d: Draft) -> None:
    _state(d, separation_m=lambda gap: gap + 4.0)


@mutant("BD-EVD-001", at=_place("separation_m"))
def separation_beyond_the_tolerance(d: Draft) -> None:
    _state(d, separation_m=lambda gap: gap + 1.1 * TOLERANCE * (1 + gap))


@mutant("BD-EVD-001", at=_place("separation_m"))
def separation_left_out(d: Draft) -> None:
    _state(d, separation_available=False, separation_m=None, separation_actor_id=None)


@mutant("BD-EVD-001", at=_place("separation_m"))
def separation_of_another_actor(d: Draft) -> None:
    _state(d, separation_actor_id=7)


@mutant("BD-EVD-001", at=_place("separation_m"))
def separation_of_an_unknown_actor(d: Draft) -> None:
    _state(d, separation_actor_id=12345)


@mutant("BD-EVD-001", at=_place("separation_m", 0, G2_NOMINAL))
def separation_to_a_cone_beside_the_corridor(d: Draft) -> None:
    # The cone's true gap: from its side at 5.25 m to the ego's, whose centre is 0.4 m left of the route.
    gap_m = 5.5 - CONE_M[1] / 2 - 0.4 - EGO_BOX_M[1] / 2
    _state(d, 0, G2_NOMINAL, separation_available=True, separation_m=gap_m, separation_actor_id=4)


# BD-EVD-002


@mutant("BD-EVD-002", at=_place("ttc_s"))
def ttc_one_percent_long(d: Draft) -> None:
    _state(d, ttc_s=lambda ttc: ttc * 1.01)


@mutant("BD-EVD-002", at=_place("ttc_s", 30))
def ttc_capped(d: Draft) -> None:
    assert d.value("evidence", "ttc_s", rollout_id=BRAKE, tick=30) > 8.0
    _state(d, 30, ttc_s=8.0)


@mutant("BD-EVD-002", at=_place("ttc_s"))
def ttc_left_out(d: Draft) -> None:
    _state(d, ttc_available=False, ttc_s=None, ttc_actor_id=None)


@mutant("BD-EVD-002", at=_place("ttc_s"))
def ttc_of_an_actor_that_parts(d: Draft) -> None:
    _state(d, ttc_actor_id=3)


@mutant("BD-EVD-002", at=_place("ttc_s", 0, G2_NOMINAL))
def ttc_where_nobody_is(d: Draft) -> None:
    _state(d, 0, G2_NOMINAL, ttc_available=True, ttc_s=499.0, ttc_actor_id=4)


# BD-EVD-003


@mutant("BD-EVD-003", at=_place("nearest_vehicle_gap_m"))
def nearest_vehicle_farther(d: Draft) -> None:
    _state(d, nearest_vehicle_gap_m=lambda gap: gap + 0.01)


@mutant("BD-EVD-003", at=_place("nearest_vehicle_rel_speed_mps"))
def relative_speed_with_the_other_sign(d: Draft) -> None:
    _state(d, nearest_vehicle_rel_speed_mps=lambda speed: -speed)


@mutant("BD-EVD-003", at=_place("nearest_pedestrian_gap_m"))
def pedestrian_left_out(d: Draft) -> None:
    _state(d, nearest_pedestrian_available=False, nearest_pedestrian_gap_m=None)


@mutant("BD-EVD-003", at=_place("nearest_vehicle_gap_m", 0, G2_NOMINAL))
def vehicle_where_nobody_is(d: Draft) -> None:
    _state(
        d, 0, G2_NOMINAL, nearest_vehicle_available=True, nearest_vehicle_gap_m=49.0, nearest_vehicle_rel_speed_mps=0.0
    )


@mutant("BD-EVD-001", at=_place("separation_m", OUTSIDE_TICK))
def separation_wrong_outside_of_the_window(d: Draft) -> None:
    _state(d, OUTSIDE_TICK, separation_m=lambda value: value + 0.1)


@boundary("BD-EVD-001", "BD-EVD-002", "BD-EVD-003")
def evidence_off_by_less_than_the_tolerance(d: Draft) -> None:
    for column in (
        "separation_m",
        "ttc_s",
        "nearest_vehicle_gap_m",
        "nearest_vehicle_rel_speed_mps",
        "nearest_pedestrian_gap_m",
    ):
        _state(d, **{column: lambda value: value + 0.99 * TOLERANCE * (1 + abs(value))})


@boundary("BD-EVD-001", "BD-EVD-002", "BD-EVD-003")
def evidence_off_by_less_than_a_wide_declared_tolerance(d: Draft) -> None:
    d.descriptor["tolerances"] = {"evidence": 0.001}
    for column in (
        "separation_m",
        "ttc_s",
        "nearest_vehicle_gap_m",
        "nearest_vehicle_rel_speed_mps",
        "nearest_pedestrian_gap_m",
    ):
        _state(d, **{column: lambda value: value - 0.0009 * (1 + abs(value))})


# Pairs exactly on a cut-off: the ego at the origin, heading along x, and actors set around it.


def _scene(d: Draft, *actors: dict[str, Any], speed_mps: float = 0.0, **evidence: Any) -> None:
    """Replace the second frame of one attempt, with its evidence stated instead of computed.

    It is one of contact, after which no motion is judged for a while.
    """
    kind = "vehicle" if evidence.get("nearest_vehicle_gap_m") == 0.0 else "static"
    d.set("rollouts", f"result_num_{kind}_collisions", 1, rollout_id=BRAKE)
    here = {"rollout_id": BRAKE, "tick": SCENE_TICK}
    d.set("observations", ("x_m", "y_m", "yaw_rad"), 0.0, **here)
    d.set("observations", "speed_mps", speed_mps, **here)
    plain = {
        "actor_class": "vehicle", "x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0,
        "length_m": 4.0, "width_m": 2.0, "height_m": 1.5, "vel_x_mps": 0.0, "vel_y_mps": 0.0,
    }  # fmt: skip
    template = d.take("actors", **here).slice(0, 1).to_pylist()[0]
    rows = [{**template, **plain, "actor_id": k, **actor} for k, actor in enumerate(actors, start=1)]
    schema = d.take("actors", **here).schema
    d.drop("actors", **here)
    d.append("actors", type(d.take("actors")).from_pylist(rows, schema=schema), folder=d.folder_of(BRAKE))
    _state(d, SCENE_TICK, num_actors=len(rows), collision=True, **{**ABSENT, **evidence})


def _ahead(gap_m: float, **more: Any) -> dict[str, Any]:
    """An actor straight ahead at a gap."""
    return {"x_m": EGO_BOX_M[0] / 2 + 2.0 + gap_m, **more}


def _beside(distance_m: float, x_m: float, **more: Any) -> dict[str, Any]:
    """A static object whose box lies at a distance to the left of the route."""
    return {"actor_class": "static", "x_m": x_m, "y_m": distance_m + 1.0, **more}


HALF_CORRIDOR_M = EGO_BOX_M[1] / 2 + 0.5


SEPARATED = ("separation_available", "separation_m", "separation_actor_id")


PROJECTED = ("ttc_available", "ttc_s", "ttc_actor_id")


def _nearest(gap_m: float, rel_mps: float = 0.0) -> dict[str, Any]:
    columns = ("nearest_vehicle_available", "nearest_vehicle_gap_m", "nearest_vehicle_rel_speed_mps")
    return dict(zip(columns, (True, gap_m, rel_mps), strict=True))


def _seen(gap_m: float, actor_id: int = 1, rel_mps: float = 0.0) -> dict[str, Any]:
    return {**_separated(gap_m, actor_id), **_nearest(gap_m, rel_mps)}


def _projected(ttc_s: float, actor_id: int = 1) -> dict[str, Any]:
    return dict(zip(PROJECTED, (True, ttc_s, actor_id), strict=True))


def _separated(gap_m: float, actor_id: int) -> dict[str, Any]:
    return dict(zip(SEPARATED, (True, gap_m, actor_id), strict=True))


def _on_cutoff(
    rule: str, name: str, actors: Sequence[dict[str, Any]], *readings: dict[str, Any], speed_mps: float = 0.0
) -> None:
    """Register one boundary per reading of a scene that the cut-off allows."""
    for k, reading in enumerate(readings):

        def edit(d: Draft, reading: dict[str, Any] = reading) -> None:
            _scene(d, *actors, speed_mps=speed_mps, **reading)

        boundary(rule, "BD-EVD-003", name=f"{name}_reading_{k}")(edit)


for label, gap in (
    ("at_the_range", 50.0),
    ("just_inside_the_range", 50.0 - 0.9e-6),
    ("just_beyond_the_range", 50.0 + 0.9e-6),
):
    _on_cutoff("BD-EVD-001", label, [_ahead(gap)], {}, _seen(gap))


for label, closing in (
    ("closing_at_the_cutoff", 0.1),
    ("closing_just_below", 0.1 - 0.9e-6),
    ("closing_just_above", 0.1 + 0.9e-6),
):
    _on_cutoff(
        "BD-EVD-002",
        label,
        [_ahead(20.0, vel_x_mps=-closing)],
        _seen(20.0, rel_mps=closing),
        {**_seen(20.0, rel_mps=closing), **_projected(20.0 / closing)},
    )


CONE_X_M = EGO_BOX_M[0] / 2 + 2.0 + 10.0
"""Ten metres ahead of the ego, beside it by less than it is wide: the gap is oblique."""


def _gap_m(distance_m: float, x_m: float = CONE_X_M) -> float:
    """Gap to the object of `_beside`, whose near corner is the closest point."""
    return math.hypot(x_m - EGO_BOX_M[0] / 2 - 2.0, distance_m - EGO_BOX_M[1] / 2)


for label, distance in (
    ("cone_at_the_corridor", HALF_CORRIDOR_M),
    ("cone_just_inside_the_corridor", HALF_CORRIDOR_M - 0.9e-6),
    ("cone_just_outside_the_corridor", HALF_CORRIDOR_M + 0.9e-6),
):
    _on_cutoff("BD-EVD-001", label, [_beside(distance, CONE_X_M)], {}, _separated(_gap_m(distance), 1))

# Of two cones on the corridor's edge each may count or not: every one of the four combinations is right.
_on_cutoff(
    "BD-EVD-001",
    "two_cones_at_the_corridor",
    [_beside(HALF_CORRIDOR_M, CONE_X_M), _beside(HALF_CORRIDOR_M, CONE_X_M + 10.0)],
    {},
    _separated(_gap_m(HALF_CORRIDOR_M), 1),
    _separated(_gap_m(HALF_CORRIDOR_M, CONE_X_M + 10.0), 2),
)

# The same for cut-offs of different kinds in one frame: a cone on the edge, a vehicle at the end of the range.
_on_cutoff(
    "BD-EVD-001",
    "cone_at_the_corridor_and_vehicle_at_the_range",
    [_beside(HALF_CORRIDOR_M + 0.5e-6, CONE_X_M), _ahead(50.0 - 0.5e-6)],
    {},
    _separated(_gap_m(HALF_CORRIDOR_M + 0.5e-6), 1),
    {**_seen(50.0 - 0.5e-6, 2), **_separated(_gap_m(HALF_CORRIDOR_M + 0.5e-6), 1)},
    _seen(50.0 - 0.5e-6, 2),
)

# Equal gaps on both sides: any of the actors may be named.
_on_cutoff(
    "BD-EVD-001",
    "two_vehicles_at_one_gap",
    [_ahead(20.0), _ahead(20.0, x_m=-(EGO_BOX_M[0] / 2 + 2.0 + 20.0))],
    _seen(20.0, 1),
    _seen(20.0, 2),
)


# Overlap and touch: separation and time to collision are 0, whatever the velocities.
for label, gap in (("touching", 0.0), ("overlapping", -1.0)):
    _on_cutoff("BD-EVD-002", label, [_ahead(gap, vel_x_mps=5.0)], {**_seen(0.0), **_projected(0.0)})


# Just beyond the slack a cut-off is one: the same scenes, read from the wrong side.


def _beyond(rule: str, name: str, actors: Sequence[dict[str, Any]], reading: dict[str, Any]) -> None:
    def edit(d: Draft) -> None:
        _scene(d, *actors, **reading)

    mutant(rule, name=name, at={"rollout_id": BRAKE, "table": "evidence", "tick": SCENE_TICK})(edit)


OFF_M = 2e-6


for label, gap, reading, rule in (
    ("separation_beyond_the_range", 50.0 + OFF_M, _separated(50.0 + OFF_M, 1), "BD-EVD-001"),
    ("vehicle_beyond_the_range", 50.0 + OFF_M, _nearest(50.0 + OFF_M), "BD-EVD-003"),
    ("separation_missing_inside_the_range", 50.0 - OFF_M, _nearest(50.0 - OFF_M), "BD-EVD-001"),
    ("vehicle_missing_inside_the_range", 50.0 - OFF_M, _separated(50.0 - OFF_M, 1), "BD-EVD-003"),
):
    _beyond(rule, label, [_ahead(gap)], reading)


for label, closing, projected in (
    ("ttc_below_the_closing_cutoff", 0.1 - OFF_M, _projected(20.0 / (0.1 - OFF_M))),
    ("ttc_missing_above_the_closing_cutoff", 0.1 + OFF_M, {}),
):
    seen = {**_seen(20.0, rel_mps=closing), **projected}
    _beyond("BD-EVD-002", label, [_ahead(20.0, vel_x_mps=-closing)], seen)


for label, distance, claimed in (
    ("cone_beyond_the_corridor_counted", HALF_CORRIDOR_M + OFF_M, True),
    ("cone_inside_the_corridor_ignored", HALF_CORRIDOR_M - OFF_M, False),
):
    _beyond("BD-EVD-001", label, [_beside(distance, CONE_X_M)], _separated(_gap_m(distance), 1) if claimed else {})

_beyond(
    "BD-EVD-003",
    "relative_speed_of_a_pedestrian",
    [_ahead(20.0), _ahead(20.0, x_m=-(EGO_BOX_M[0] / 2 + 22.0), actor_class="pedestrian", vel_x_mps=-3.0)],
    {**_seen(20.0, rel_mps=-3.0), "nearest_pedestrian_available": True, "nearest_pedestrian_gap_m": 20.0},
)
_beyond("BD-EVD-002", "ttc_missing_on_overlap", [_ahead(-1.0, vel_x_mps=5.0)], _seen(0.0))
_beyond("BD-EVD-003", "relative_speed_on_overlap", [_ahead(-1.0)], {**_seen(0.0, rel_mps=1.0), **_projected(0.0)})


# Several places: what violates a rule is counted


@mutant("BD-EVD-001", at={"rollout_id": FURTHER, "tick": BRANCH_TICK}, findings=2, lost=2)
def separations_of_two_attempts_between_centres(d: Draft) -> None:
    d.set("evidence", "separation_m", lambda gap: gap + 4.0, rollout_id=BOTH, tick=BRANCH_TICK)
