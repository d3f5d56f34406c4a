"""Sign, unit and clock of recorded motion, and place of the pose: what attempts record, against what their poses say.

Between neighbouring observations 0 and 1 of an attempt, ``dt`` apart, with the position ``p``, the heading ``yaw``,
``u = (cos yaw, sin yaw)``, the speed ``v``, the way ``s = |p_1 - p_0|`` and the turn ``q = wrap(yaw_1 - yaw_0)``::

    quantity        recorded              of the poses        where
    speed           |v_0 + v_1| dt / 2    s                   s / dt >= 2 m/s
    yaw rate        (w_0 + w_1) / 2       q / dt              |q / dt| >= 0.05 rad/s
    longitudinal    a_longitudinal        (v_1 - v_0) / dt    |(v_1 - v_0) / dt| >= 0.5 m/s2
    lateral         a_lateral             v_1 q / dt          |v_1 q / dt| >= 0.5 m/s2

The ratio of an attempt is the slope of the regression through the origin, ``sum(r c) / sum(c c)``, of recorded values
``r`` on those of the poses ``c``; of speeds it is ``sum(r) / sum(c)``, of vehicles and pedestrians too, and
``sum(|r - c|) / sum(c)`` is the share of the way by which single steps are off. No ratios are the angles from the mean
heading to the displacement, and from the heading of vehicles to their velocity, on straight ways; and the share of the
velocity of vehicles along their heading. Where no policy is active, steering and drive are the slopes of ``q / dt`` on
``-v`` times the mean steering, and of the gain of speed on throttle minus brake. Where the vehicle is declared, what it
would do at these commands is compared with what was done: ``-v tan(a u) / w`` on ``q / dt``, with the angle ``a`` of
the wheels at full steering and the wheelbase ``w``, and the deceleration at the brake command on the loss of speed.

The rear axle of a vehicle that rolls slowly does not slip: a point ``b`` ahead of it moves across the mean heading by
``2 b sin(q / 2)`` over an arc. So the slope of that way on ``q`` says how far ahead of the axle the recorded pose is.

Contacts are compared too: what a few of them do to an attempt is no value of nearly all attempts, and no mask switches
a unit off. Source: spec/07-rules.md#calibration.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.descriptor import Vehicle
from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import HISTORY_OFFSETS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.angle import wrap_rad
from branchdrive.raw.copies import Copies
from branchdrive.raw.motion.clock import LEADS, OF_YAW_RATES, lead, leads_of_actors, leads_of_ego
from branchdrive.raw.motion.contact import is_free
from branchdrive.raw.motion.quantity import is_none_of_one, wrong_of_one
from branchdrive.raw.motion.residual import OBSERVATION_S, follows
from branchdrive.raw.motion.terms import Steps, Terms
from branchdrive.raw.motion.tracks import actor_steps
from branchdrive.raw.shard_view import ShardView

__all__ = ["calibration", "calibration_between_contacts"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_STEPS = 4
"""Observations below which an attempt says nothing: less than a second."""

MIN_SPEED_MPS = 2.0
MIN_RATE_RADPS = 0.05
MIN_ACCELERATION_MPS2 = 0.5
"""Motion below these says nothing: it would compare noise and what happens inside of a quarter second."""

MIN_WALK_MPS = 1.0
"""The same of pedestrians."""

MIN_SINE = 0.5
"""Sine of the least angle between velocity and x axis: along that axis, a heading of the wrong sense is the same."""

MAX_ROLLING_MPS = 8.0
"""Speed up to which the rear axle rolls: its slip grows with the square of the speed, to a few decimetres here."""

MAX_GRIP_MPS2 = 2.0
"""Lateral acceleration up to which tyres hardly slip, and a vehicle turns as its wheels point."""

MIN_BRAKE = 0.2
"""Brake command below which drag and rolling count for more."""

MAX_STRAIGHT_RAD = 0.01
"""Turn of a straight way: on others the centre of a box slips to the side."""

_SLOPES = ("yaw_rate", "longitudinal", "lateral", "steering", "pivot", *LEADS)
"""Quantities of regressions, in which a step weighs by its square: one of a skid or a blow may weigh more than all."""

_OF_STRETCHES = ("yaw_rate", "longitudinal", "lateral"), ("yaw_rate", "lateral")
"""Quantities whose sign is judged up to the branch as well, and from it on, where brakes come and go at once."""

_ANGLES = ("heading", "actor_heading")
"""Quantities that are the angle of two sums, in degrees; others are their ratio."""


def calibration(view: ShardView) -> dict[str, Array]:
    """Values of every quantity in every attempt ``[rollouts]``, NaN where it says nothing of it; six decimals."""
    return view.cached(_calibrations)[0]


def calibration_between_contacts(view: ShardView) -> dict[str, Array]:
    """The same between contacts: of all observations that none keeps from being judged, and of two stretches of them.

    Each is ``[3, rollouts]``; the second is that from ``t_b - 75`` to ``t_b``, the third that from ``t_b`` on, NaN but
    for `_OF_STRETCHES`, whose sign may change there. A slope that is not right of one attempt is that without
    the step of the greatest weight: one step alone makes none wrong.
    """
    return view.cached(_calibrations)[1]


@np.errstate(all="ignore")  # what overflows is no number, and says nothing
def _calibrations(view: ShardView) -> tuple[dict[str, Array], dict[str, Array]]:
    """Both at once, and first those of the ego, so that terms, which are large, need not be kept."""
    every, between = _of_terms(view, _of_ego(view) | leads_of_ego(view))
    if "actors" in view:
        of_actors = _of_terms(view, _of_actors(view))
        every, between = every | of_actors[0], between | of_actors[1]
    return every, between


def _of_terms(view: ShardView, terms: dict[str, Terms]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Values of quantities in every attempt, and between contacts, from their terms."""
    every = _values_of(view, terms)
    observations, found, free = view.observations, every, view.cached(is_free)
    touched = observations.by_rollout(~free).any
    if touched.any():
        between = _steps_between(free & np.append(touched, False)[observations.rollout])
        of_touched = _values_of(view, terms, between)
        found = {name: np.where(touched, of_touched[name], values) for name, values in every.items()}
    offset = observations.tick - np.append(view.branch_tick, 0)[observations.rollout]
    judged = free & np.append(view.branched, False)[observations.rollout]
    stretches = judged & (offset >= HISTORY_OFFSETS[0]) & (offset <= 0), judged & (offset >= 0)
    spans = [_steps_between(counts) for counts in (free, *stretches)]
    nothing = np.full(view.num_rollouts, np.nan)
    parts: dict[str, Array] = {}
    for name, values in found.items():
        of_stretches = [
            _value(view, name, terms[name], span) if name in names else nothing
            for span, names in zip(spans[1:], _OF_STRETCHES, strict=True)
        ]
        parts[name] = np.stack([values, *of_stretches])
    for name in _SLOPES:
        if name in parts:
            for values, span, wrong in zip(parts[name], spans, wrong_of_one(name, parts[name]), strict=True):
                if wrong.any():
                    others, ratio = _without_weightiest(view, terms[name], span, wrong), _ratio(name, found)
                    values[wrong] = _value(view, name, others, ratio=ratio)[wrong]
    return every, parts


def _without_weightiest(view: ShardView, terms: Terms, counts: Mask, attempts: Mask) -> Terms:
    """Terms of the steps that count in attempts, but for the one of the greatest weight in each."""
    row, own = terms.row, view.observations.rollout
    chosen = np.flatnonzero(counts[row] & np.append(attempts, False)[own[row]])
    order = chosen[np.lexsort((terms.parts[1][chosen], own[row[chosen]]))]
    owner = own[row[order]]
    return terms.take(order[np.append(owner[1:] == owner[:-1], False)[: len(owner)]])


def _steps_between(counts: Mask) -> Mask:
    """Observations that count, as the ones before them do ``[observations]``."""
    return np.append(False, counts[1:] & counts[:-1])[: len(counts)]


def _ratio(name: str, values: dict[str, Array]) -> Array | float:
    """Ratio of recorded values to those of the positions that a lead is measured with, of values that are known.

    NaN where yaw rates have a value that is right of no attempt: it is that which is judged of them, and not their time
    or that of what is held against them. As that of others, the lead of yaw rates needs a value.
    """
    ratio = values.get(LEADS.get(name, ""), 1.0)
    if name not in OF_YAW_RATES:
        return ratio
    value = values["yaw_rate"]
    is_judged = ~is_none_of_one("yaw_rate", value) & (np.isfinite(value) | (name != "yaw_rate_lead"))
    return np.where(is_judged, ratio, np.nan)


def _values_of(view: ShardView, terms: dict[str, Terms], counts: Mask | None = None) -> dict[str, Array]:
    """Values of quantities in every attempt; those of ratios come before the leads that need them."""
    found: dict[str, Array] = {}
    for name, each in terms.items():
        found[name] = _value(view, name, each, counts, _ratio(name, found))
    return found


def _value(view: ShardView, name: str, terms: Terms, counts: Mask | None = None, ratio: Array | float = 1.0) -> Array:
    """Value of a quantity in every attempt, over the steps that count, by the observation they lead to ``[rollouts]``.

    All count where nothing is said.
    """
    if counts is not None:
        terms = terms.take(np.flatnonzero(counts[terms.row]))
    owner, num_attempts = view.observations.rollout[terms.row], view.num_rollouts
    steps = np.bincount(owner, minlength=num_attempts)
    sums = [np.asarray(np.bincount(owner, part, num_attempts), np.float64) for part in terms.parts]
    if name in LEADS:
        by_change, changes, mixed = sums
        values = lead(by_change, changes, mixed, ratio)
    elif name in _ANGLES:
        values = np.degrees(np.arctan2(*sums))
    else:
        values = sums[0] / sums[1]
    return np.where(np.isfinite(values) & (steps >= MIN_STEPS), np.round(values, 6), np.nan)


def _of_ego(view: ShardView) -> dict[str, Terms]:
    stream = view.observations
    every = np.flatnonzero(follows(stream))
    distinct, place = view.cached(Copies).rows("observations").distinct(every, every - 1, len(stream))
    row, steps = every[distinct], Steps(every, place)
    x, y, yaw, speed, rate, along, across = (
        [stream[name][rows].astype(np.float64) for rows in (row - 1, row)]
        for name in (
            "x_m", "y_m", "yaw_rad", "speed_mps", "yaw_rate_radps", "accel_longitudinal_mps2", "accel_lateral_mps2",
        )
    )  # fmt: skip
    way_x, way_y, turn = x[1] - x[0], y[1] - y[0], wrap_rad(yaw[1] - yaw[0])
    way, turning = np.hypot(way_x, way_y), turn / OBSERVATION_S
    mean_speed, gained = (speed[1] + speed[0]) / 2, (speed[1] - speed[0]) / OBSERVATION_S
    heading, sense = yaw[1] - turn / 2, np.sign(mean_speed)
    cos, sin = np.cos(heading), np.sin(heading)
    ahead, left = sense * (cos * way_x + sin * way_y), sense * (cos * way_y - sin * way_x)
    drives, pushed = way >= MIN_SPEED_MPS * OBSERVATION_S, speed[1] * turning
    turns, gains = np.abs(turning) >= MIN_RATE_RADPS, np.abs(gained) >= MIN_ACCELERATION_MPS2
    recorded_way = np.abs(mean_speed) * OBSERVATION_S
    found = {
        "speed": steps.terms(drives, recorded_way, way),
        "step": steps.terms(drives, np.abs(recorded_way - way), way),
        "yaw_rate": steps.slope(turns, (rate[1] + rate[0]) / 2, turning),
        "longitudinal": steps.slope(gains, along[1], gained),
        "lateral": steps.slope(np.abs(pushed) >= MIN_ACCELERATION_MPS2, across[1], pushed),
        "heading": steps.terms(drives & (np.abs(turn) <= MAX_STRAIGHT_RAD), left, ahead),
    }
    side = stream.equals("command", "left")[row].astype(np.float64) - stream.equals("command", "right")[row]
    vehicle = view.descriptor.vehicle or Vehicle()
    if vehicle.wheelbase_m is not None:
        rolls = turns & (np.abs(mean_speed) <= MAX_ROLLING_MPS)
        found["pivot"] = steps.terms(rolls, (cos * way_y - sin * way_x) * turn, turn**2 * vehicle.wheelbase_m)
    found["command"] = steps.terms(turns & (side != 0), turning * side, np.ones(len(row)))
    # Commands are of another table: where it matters, every step is looked at by itself.
    moving = np.flatnonzero((drives & (turns | gains))[place])
    one = place[moving]
    return found | _of_commands(view, every[moving], *(values[one] for values in (mean_speed, turning, gained)))


def _of_commands(view: ShardView, row: Index, mean_speed: Array, turning: Array, gained: Array) -> dict[str, Terms]:
    """Terms of the quantities of commands, from steps of moving egos to observations, each field ``[steps]``."""
    steps, sense = Steps(row, np.arange(len(row))), np.sign(mean_speed)
    turns, gains = np.abs(turning) >= MIN_RATE_RADPS, np.abs(gained) >= MIN_ACCELERATION_MPS2
    steer, throttle, brake = _commands(view, row)
    found = {
        "steering": steps.slope(turns, turning, -steer * mean_speed),
        "drive": steps.slope(gains, gained * sense, throttle - brake),
    }
    vehicle = view.descriptor.vehicle or Vehicle()
    if vehicle.wheelbase_m is not None and vehicle.max_steer_rad is not None:
        declared = -mean_speed * np.tan(vehicle.max_steer_rad * steer) / vehicle.wheelbase_m
        grips = np.abs(mean_speed * turning) <= MAX_GRIP_MPS2
        found["vehicle_turn"] = steps.slope(turns & grips, declared, turning)
    if vehicle.max_decel_mps2 is not None:
        brakes = gains & (throttle == 0) & (brake >= MIN_BRAKE)
        found["vehicle_brake"] = steps.slope(brakes, vehicle.max_decel_mps2 * brake, -gained * sense)
    return found


def _commands(view: ShardView, row: Index) -> Array:
    """Mean applied steering, throttle and brake from the observation before each row to it ``[3, rows]``.

    NaN where a control row is missing, or the policy is active at one.
    """
    controls, observations = view.controls, view.observations
    first, last = (
        controls.find(observations.rollout[row], observations.tick[row] - ticks)
        for ticks in (OBSERVATION_STRIDE_TICKS, 1)
    )
    num_active = np.append(0, np.cumsum(controls["active"]))
    is_free = num_active[last + 1] == num_active[first]
    known = np.flatnonzero((first >= 0) & (last - first == OBSERVATION_STRIDE_TICKS - 1) & is_free)
    found = np.full((3, len(row)), np.nan)
    for mean, name in zip(found, ("steer", "throttle", "brake"), strict=True):
        applied = controls[f"applied_{name}"]
        total = sum(applied[first[known] + tick].astype(np.float64) for tick in range(OBSERVATION_STRIDE_TICKS))
        mean[known] = total / OBSERVATION_STRIDE_TICKS
    return found


def _of_actors(view: ShardView) -> dict[str, Terms]:
    """Terms of the quantities of actors, from steps of those who move."""
    stream, every = view.stream("actors"), view.cached(actor_steps)
    row, before = every.row[every.distinct], every.before[every.distinct]
    way_x, way_y = (stream[name][row] - stream[name][before] for name in ("x_m", "y_m"))
    way = np.hypot(way_x, way_y) / OBSERVATION_S
    moves = np.flatnonzero(way >= MIN_WALK_MPS)
    place = np.full(len(row), -1)
    place[moves] = np.arange(len(moves))
    moving = np.flatnonzero((place >= 0)[every.place])
    steps = Steps(view.observations.rows_of(stream)[every.row[moving]], place[every.place[moving]])
    row, before, way = row[moves], before[moves], way[moves]
    vel_x, vel_y = (
        np.add(stream[name][row], stream[name][before], dtype=np.float64) / 2 for name in ("vel_x_mps", "vel_y_mps")
    )
    speed, is_fast = np.hypot(vel_x, vel_y), way >= MIN_SPEED_MPS
    codes, names = stream.categories("actor_class")
    is_vehicle, is_walker = (
        np.array([name in classes for name in (*names, None)])[codes[row]]
        for classes in (("vehicle", "cycle"), ("pedestrian",))
    )
    yaw = stream["yaw_rad"][row].astype(np.float64)
    turn = wrap_rad(yaw - stream["yaw_rad"][before])
    cos, sin = np.cos(yaw - turn / 2), np.sin(yaw - turn / 2)
    along, across, is_driving = cos * vel_x + sin * vel_y, cos * vel_y - sin * vel_x, is_vehicle & is_fast
    is_aslant = np.abs(vel_y) >= MIN_SINE * speed
    return {
        "actor_sense": steps.terms(is_driving & is_aslant, along, speed),
        "actor_heading": steps.terms(is_driving & (np.abs(turn) <= MAX_STRAIGHT_RAD), np.abs(across), along),
        "actor_speed": steps.terms(is_driving, speed, way),
        "pedestrian_speed": steps.terms(is_walker, speed, way),
        "pedestrian_sense": steps.terms(is_walker & is_aslant, along, speed),
        **leads_of_actors(view, moving[is_driving[steps.place]], way_x, way_y),
    }
