"""Invented drives without a simulator: routes, actors beside them, and a car that follows its policy.

The car is a kinematic bicycle with an expert that keeps it on its route; interventions override the
expert as the definitions say, written down here once more and not taken from the library.

What is recorded lies on a grid of binary fractions, so that processors whose sines differ in the last bit record the
same, and files compress well.

Frames: world, x forward, y left, yaw counter-clockwise; steering positive to the right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from branchdrive.contract.bank import ActionBank, load_action_bank

TICK_S = 0.05
STRIDE = 5
BRANCH_TICK = 100
TRIGGER_TICK = 120
NUM_TICKS = 201
WINDOW_TICKS = 50
EGO_BOX_M = (4.5, 1.875, 1.5)
Array = np.ndarray[Any, np.dtype[Any]]

_STEPS = 4096
"""Steps of the grid in a unit."""


def on_grid(values: Any, steps: int = _STEPS) -> Array:
    """Values rounded to multiples of 1/4096 of their unit, or of a finer step, none of them a negative zero."""
    return np.asarray(np.round(np.asarray(values, float) * steps) / steps + 0.0)


def angle_on_grid(angle_rad: Any) -> Array:
    """Angles from -pi to pi, rounded to multiples of 1/4096 that are within."""
    wrapped_rad = (angle_rad + np.pi) % (2 * np.pi) - np.pi
    last_rad = np.floor(np.pi * _STEPS) / _STEPS
    return np.asarray(np.clip(on_grid(wrapped_rad), -last_rad, last_rad))


@dataclass(frozen=True)
class Route:
    """A straight line, or an arc to the left, from `start` in direction `heading_rad`."""

    start: tuple[float, float]
    heading_rad: float
    radius_m: float = np.inf
    length_m: float = 160.0

    def point(self, progress_m: Any, offset_m: Any = 0.0) -> tuple[Array, Array, Array]:
        """World x, y and heading at an arc length and an offset to the left."""
        progress, offset = np.broadcast_arrays(np.asarray(progress_m, float), np.asarray(offset_m, float))
        turned = progress / self.radius_m
        heading = self.heading_rad + turned
        straight = np.isinf(self.radius_m)
        chord = progress if straight else 2 * self.radius_m * np.sin(turned / 2)
        along = self.heading_rad + turned / 2
        x = self.start[0] + chord * np.cos(along) - offset * np.sin(heading)
        y = self.start[1] + chord * np.sin(along) + offset * np.cos(heading)
        return x, y, heading

    def locate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Arc length, offset to the left and heading of the route beside world points."""
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        ahead = cos * (x - self.start[0]) + sin * (y - self.start[1])
        left = cos * (y - self.start[1]) - sin * (x - self.start[0])
        if np.isinf(self.radius_m):
            return ahead, left, np.full_like(x, self.heading_rad)
        turned = np.arctan2(ahead, self.radius_m - left)
        return turned * self.radius_m, self.radius_m - np.hypot(ahead, self.radius_m - left), self.heading_rad + turned


@dataclass(frozen=True)
class InventedActor:
    """An actor on a route: start, speeds along and across it, and the ticks at which it is there."""

    kind: str
    box_m: tuple[float, float, float]
    progress_m: float
    offset_m: float
    speed_mps: float = 0.0
    lateral_mps: float = 0.0
    first_tick: int = 0
    last_tick: int = NUM_TICKS


CAR_M, CYCLE_M, PERSON_M, CONE_M = (4.25, 1.75, 1.5), (1.75, 0.625, 1.75), (0.5, 0.5, 1.75), (0.5, 0.5, 0.75)


@dataclass(frozen=True)
class InventedScene:
    """Where a group drives, and among whom.

    Attributes:
        start: Progress and offset on the route and speed, in m and m/s, of the ego at the first tick.
        noise: Standard deviation of the offset and the speed at which each replay starts beside the nominal;
            ``None`` for steps of 0.001 from one attempt to the next.
        moved_m: How much further than in the nominal the actors start, by place of the attempt.
    """

    route: Route
    actors: tuple[InventedActor, ...]
    town: str
    scenario_type: str = "CutIn"
    start: tuple[float, float, float] = (2.0, 0.4, 6.0)
    noise: float | None = None
    moved_m: Mapping[int, float] = field(default_factory=dict)

    def departures(self, count: int, seed: int) -> Array:
        """Offset and speed of each attempt beside those of the nominal, ``[2, attempts]``."""
        if self.noise is None:
            return np.tile(np.arange(count) * 0.001, (2, 1))
        drawn = np.random.default_rng(seed).normal(0.0, self.noise, (2, count))
        drawn[:, 0] = 0.0
        return np.asarray(drawn)


@dataclass(frozen=True)
class Plan:
    """One attempt to drive; a drive may decide again, at ticks and for action keys."""

    role: str
    action_key: str
    attempt: int = 1
    branch_tick: int = BRANCH_TICK
    later: tuple[tuple[int, str], ...] = ()

    @property
    def decisions(self) -> tuple[tuple[int, str], ...]:
        """Tick and action key of every decision; of a nominal rollout or replay none."""
        begins = self.role in ("intervention", "drive")
        return ((self.branch_tick, self.action_key), *self.later) if begins else ()

    def rollout_id(self, group_id: str) -> str:
        """Identifier of the attempt in a group."""
        stem = {"nominal_replay": self.role, "drive": f"drive-{self.action_key}"}.get(self.role, self.action_key)
        return f"{group_id}.{stem}.a{self.attempt}"


def group_name(index: int) -> str:
    """Identifier of group `index`."""
    return f"g{index}"


def plans(index: int, bank: ActionBank | None = None, branch_tick: int = BRANCH_TICK) -> list[Plan]:
    """Attempts of group `index`; group 1 repeats one action, and both attempts are good."""
    bank = bank or load_action_bank()
    planned = [Plan("nominal", bank.nominal.key)]
    planned += [Plan("intervention", policy.key) for policy in bank.interventions]
    planned += [Plan("nominal_replay", bank.nominal.key, attempt) for attempt in (1, 2)]
    planned += [Plan("intervention", "brake_0.50", 2)] if index == 1 and "brake_0.50" in bank.keys else []
    return [Plan(p.role, p.action_key, p.attempt, branch_tick) for p in planned]


def _demand(rule: str, value: float | None, expert: np.float32, nominal: np.float32) -> np.float32:
    match rule:
        case "online_expert":
            return expert
        case "stored_nominal":
            return nominal
        case "zero":
            return np.float32(0)
        case "absolute":
            return np.float32(value)
        case _:
            return max(expert, np.float32(value))


@dataclass
class Drive:
    """Attempts of a group side by side: state ``[ticks, attempts]``, commands ``[ticks, attempts, 3]`` float32.

    Of a policy that copies, ``stored`` is what it finds.
    """

    x_m: Array
    y_m: Array
    yaw_rad: Array
    speed_mps: Array
    expert: Array
    applied: Array
    stored: Array
    active: Array


def _expert(route: Route, x: Array, y: Array, yaw: Array, speed: Array, tick: int) -> Array:
    _, offset, heading = route.locate(x, y)
    error = (yaw - heading + np.pi) % (2 * np.pi) - np.pi
    target = 8.0 if tick < TRIGGER_TICK else 4.0
    steer = 0.6 * error + 0.06 * offset - np.arctan(2.8 / route.radius_m) / 0.6
    throttle = np.where(speed > target, 0.0, 0.25 + 0.3 * (target - speed))
    brake = 0.25 * (speed - target - 0.25)
    clipped = [np.clip(steer, -1, 1), np.clip(throttle, 0, 1), np.clip(brake, 0, 1)]
    return on_grid(np.stack(clipped, axis=1)).astype(np.float32)


def drive(
    scene: InventedScene, planned: Sequence[Plan], bank: ActionBank, num_ticks: int = NUM_TICKS, *, seed: int = 0
) -> Drive:
    """Drive all attempts tick by tick; others store commands of attempt 0, the nominal, until they decide again."""
    route, count = scene.route, len(planned)
    aside, faster = scene.departures(count, seed)  # replays start almost alike
    progress, offset, first_speed = scene.start
    x, y, yaw = (np.array(v) for v in route.point(np.full(count, progress), offset + aside))
    speed = first_speed + faster
    state = np.zeros((4, num_ticks, count))
    expert, applied, stored = (np.zeros((num_ticks, count, 3), np.float32) for _ in range(3))
    active = np.zeros((num_ticks, count), bool)
    for tick in range(num_ticks):
        state[:, tick] = x, y, yaw, speed
        command = _expert(route, x, y, yaw, speed, tick)
        expert[tick], applied[tick] = command, command
        for i, plan in enumerate(planned):
            made = [decision for decision in plan.decisions if decision[0] <= tick]
            stored[tick, i] = command[i if len(made) > 1 else 0]
            if not made or tick >= made[-1][0] + bank[made[-1][1]].duration_ticks:
                continue
            active[tick, i] = True
            for k, rule in enumerate(bank[made[-1][1]].rules):
                applied[tick, i, k] = _demand(rule.rule, rule.value, command[i, k], stored[tick, i, k])
        steer, throttle, brake = applied[tick].astype(float).T
        x, y = x + TICK_S * speed * np.cos(yaw), y + TICK_S * speed * np.sin(yaw)
        yaw = yaw - TICK_S * speed * np.tan(0.6 * steer) / 2.8
        speed = np.maximum(speed + TICK_S * (3.0 * throttle - 6.0 * brake - 0.09 * speed), 0.0)
    wrapped = (state[2] + np.pi) % (2 * np.pi) - np.pi
    return Drive(state[0], state[1], wrapped, state[3], expert, applied, stored, active)


def _route_position(x: Array, y: Array, line_x: Array, line_y: Array) -> tuple[Array, Array, Array]:
    """Progress, offset and heading at the nearest foot on a polyline, from the definition."""
    ex, ey, px, py = np.diff(line_x), np.diff(line_y), x[:, None] - line_x[:-1], y[:, None] - line_y[:-1]
    share = np.clip((px * ex + py * ey) / (ex**2 + ey**2), 0, 1)
    distance = np.hypot(px - share * ex, py - share * ey)
    point, best = np.arange(len(x)), distance.argmin(axis=1)
    length = np.hypot(ex, ey)
    progress = (np.cumsum(length) - length)[best] + share[point, best] * length[best]
    side = np.sign(ex[best] * py[point, best] - ey[best] * px[point, best])
    return progress, side * distance[point, best], np.arctan2(ey, ex)[best]


def route_columns(x: Array, y: Array, yaw: Array, line: tuple[Array, Array]) -> dict[str, Array]:
    """Route state and target points, 8 and 16 m ahead, of poses along a polyline."""
    progress, offset, heading = _route_position(x, y, *line)
    arc = np.concatenate([[0], np.cumsum(np.hypot(*map(np.diff, line)))])
    columns = {
        "route_progress_m": progress, "route_offset_m": offset,
    }  # fmt: skip
    for number, lead_m in ((1, 8.0), (2, 16.0)):
        to_x, to_y = (np.interp(progress + lead_m, arc, values) for values in line)
        columns[f"target_point_{number}_x_m"] = np.cos(yaw) * (to_x - x) + np.sin(yaw) * (to_y - y)
        columns[f"target_point_{number}_y_m"] = np.cos(yaw) * (to_y - y) - np.sin(yaw) * (to_x - x)
    recorded = {name: on_grid(values) for name, values in columns.items()}
    recorded["route_heading_error_rad"] = angle_on_grid(yaw - heading)
    return {name: values.astype(np.float32) for name, values in recorded.items()}
