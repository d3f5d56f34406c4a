"""Infraction rules: departures from the road, red lights and stop signs that are counted are those of the rows.

Source: spec/05-raw-streams.md#results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.driving.neighbour import Points, neighbours
from branchdrive.raw.map_work import within_limits
from branchdrive.raw.motion.contact import is_covered
from branchdrive.raw.motion.residual import follows
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.town_map import home_towns, is_usable


def _infractions(view: ShardView, kind: str) -> NDArray[np.int64]:
    """Infractions of a kind that each attempt counts, -1 where they are not monitored ``[rollouts]``."""
    column = f"result_num_{kind}_infractions"
    return np.where(view.rollouts.valid(column), view.rollouts[column].astype(np.int64), -1)


def _departures(view: ShardView) -> NDArray[np.int64]:
    """Observations off the road whose predecessor is none or on it, by attempt."""
    evidence = view.stream("evidence")
    is_off = ~evidence["on_road"].astype(bool)
    return evidence.by_rollout(is_off & ~(follows(evidence) & np.append(False, is_off[:-1]))).count


def _lights(view: ShardView) -> tuple[Mask, Mask]:
    """Observations with a red light, and those that are the first without a signal ``[evidence]``."""
    evidence = view.stream("evidence")
    is_governed = evidence["traffic_light_available"].astype(bool)
    is_left = follows(evidence) & ~is_governed & np.append(False, is_governed[:-1])
    return is_governed & evidence.equals("traffic_light", "red"), is_left


def _lacks(view: ShardView, kind: str) -> Mask:
    """Attempts in towns whose map holds no element of a kind; none without maps."""
    if "map" not in view:
        return np.zeros(view.num_rollouts, bool)
    towns = set(view.map["town"][view.map.equals("kind", kind)])
    return np.array([town not in towns for town in view.rollouts["town"]], bool)


def _misses_signs(view: ShardView, attempts: Mask) -> Mask:
    """Those of `attempts` whose ego comes near none of the stop signs of its town, all of which are usable.

    Raises:
        PreconditionError: The maps exceed the limits.
    """
    if not attempts.any():
        return attempts
    elements, observations, homes = view.map, view.observations, home_towns(view)
    is_sign, is_known = elements.equals("kind", "stop_sign"), is_usable(view)
    signs = np.flatnonzero(is_sign & is_known & (homes >= 0))
    town = view.rollouts.categories("town")[0].astype(np.int64)
    place = np.flatnonzero(np.append(attempts, False)[observations.rollout])
    near = np.isin(town, homes[is_sign & ~is_known])
    x, y = (np.array([vertices[0] for vertices in elements[name][signs]], float) for name in ("x_m", "y_m"))
    owner = observations.rollout[place]
    egos = Points(town[owner], observations["x_m"][place], observations["y_m"][place])
    with within_limits(view) as work:
        for ego, _ in neighbours(egos, Points(homes[signs], x, y), physical_bounds().sign_m, work):
            near[owner[ego]] = True
    return attempts & ~near


@rule("BD-RES-004")
def infractions_agree_with_the_rows(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Departures from the road are those of ``on_road``; lights and stop signs that are run are there, and near."""
    off_road, red, stop = (_infractions(view, kind) for kind in ("off_road", "red_light", "stop_sign"))
    has_map, no_signal, no_sign = "map" in view, _lacks(view, "signal"), _lacks(view, "stop_sign")
    covered, departures, lit = (np.zeros(view.num_rollouts, kind) for kind in (bool, np.int64, bool))
    if "evidence" in view:
        covered, departures = view.cached(is_covered), _departures(view)
        lit = view.stream("evidence").by_rollout(np.logical_or(*_lights(view))).any
    subjects = subjects & (((red >= 0) | (off_road >= 0)) & covered | ((red >= 0) | (stop >= 0)) & has_map)
    misses = _misses_signs(view, subjects & (stop > 0) & ~no_sign) if has_map else no_sign
    found = {  # attempts at fault, what their rows show, and what they count
        "off_road": ((off_road >= 0) & covered & (off_road != departures), departures, off_road),
        "red_light": ((red > 0) & (no_signal | covered & ~lit), np.zeros_like(red), red),
        "stop_sign": ((stop > 0) & no_sign | misses, np.zeros_like(stop), stop),
    }

    def describe(i: int) -> Mismatch:
        kind = next(kind for kind, (is_bad, _, _) in found.items() if is_bad[i])
        _, shown, counted = found[kind]
        why = {
            "off_road": "as `on_road` becomes false so often",
            "red_light": "as no signal is red, and none governs up to its line",
            "stop_sign": (
                f"as the ego comes within {physical_bounds().sign_m:g} m of none"
                if misses[i]
                else "as the map of the town holds none"
            ),
        }[kind]
        place: Location = {"table": "rollouts", "column": f"result_num_{kind}_infractions"}
        return Mismatch(place, f"{shown[i]}, {why}", f"{counted[i]}")

    yield Check.of_subjects(subjects, subjects & np.logical_or.reduce([bad for bad, _, _ in found.values()]), describe)


def _may_run(view: ShardView) -> Mask:
    """Attempts that may have run a light: one that is not green is the last of a signal, or of all ``[rollouts]``.

    Where a signal governs at the next observation, too, it is the same one if the ego is in the same lane.
    """
    evidence = view.stream("evidence")
    is_governed = evidence["traffic_light_available"].astype(bool)
    lane, is_known = evidence.categories("lane_id")[0], evidence.valid("lane_id")
    is_same = follows(evidence)[1:] & is_governed[1:] & (lane[1:] == lane[:-1]) & is_known[1:] & is_known[:-1]
    is_last = np.append(~is_same, True)[: len(evidence)]
    return evidence.by_rollout(is_governed & is_last & ~evidence.equals("traffic_light", "green")).any


@rule("BD-RES-006")
def red_lights_are_counted(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Who drives on, and is governed by a red light at an observation and by none at the next, has run it.

    Who leaves signals whose last light is green has run none.
    """
    evidence, observations = view.stream("evidence"), view.observations
    is_red, is_left = _lights(view)
    speed = np.append(np.abs(observations["speed_mps"]), 0.0)[observations.rows_of(evidence)]
    run = evidence.by_rollout(is_left & np.append(False, is_red[:-1]) & (speed > physical_bounds().driving_mps))
    left, counted = evidence.by_rollout(is_left), _infractions(view, "red_light")
    shows_all = view.cached(is_covered) & left.any & (counted > 0)
    invented = shows_all & ~_may_run(view)

    def describe(i: int) -> Mismatch:
        place: Location = {"table": "rollouts", "column": "result_num_red_light_infractions"}
        if invented[i]:
            tick = int(evidence.tick[left.first_row[i]])
            return Mismatch(place, f"0, as lights are green when they are passed, before tick {tick}", f"{counted[i]}")
        tick = int(evidence.tick[run.first_row[i]])
        return Mismatch(place, f"a red light that was run, as none governs any more at tick {tick}", "0")

    subjects = subjects & (run.any & (counted >= 0) | shows_all)
    yield Check.of_subjects(subjects, subjects & (run.any & (counted == 0) | invented), describe)
