"""Response rules: what the interventions of the whole dataset do refutes, or does not, what its descriptor declares.

One attempt proves little, since a vehicle may stand, slide or touch; what holds of nearly all of them is no accident.
Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.limits import physical_bounds
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import CATALOGUE, rule
from branchdrive.contract.text import quote
from branchdrive.driving.response import NO_RESPONSE, Responses, Sights
from branchdrive.driving.unit import wrong_unit
from branchdrive.files.group_marks import last_rows
from branchdrive.files.survey import Survey
from branchdrive.raw.motion.quantity import OF_VEHICLE, QUANTITIES, Quantity

MIN_INTERVENTIONS = 8
"""Interventions, attempts or tracks below which nothing is concluded; nine in ten of fewer is all of them."""

MIN_EQUAL = 3
"""Groups with equal futures under other commands, or reversed responses of two policies, that are no accident."""

MOST_NEIGHBOURS = 64
"""Groups that each is compared with at most, of those that are most like it by one number."""

PHYSICAL = {
    "BD-RTE-001": "observations",
    "BD-RTE-003": "observations",
    "BD-MOT-001": "observations",
    "BD-MOT-002": "observations",
    "BD-MOT-003": "observations",
    "BD-ACT-004": "actors",
    "BD-MAP-005": "evidence",
    "BD-MAP-006": "evidence",
    "BD-RES-001": "rollouts",
}
"""Rules that nearly all attempts fail where frame, unit, clock, map or counts are wrong, and their tables."""

SHARE_PERCENT = 90
"""Percentage of interventions that must show the same for it to be no accident."""


def _responses(survey: Survey) -> Responses:
    return Responses.of_all(shard.responses for shard in survey.shards)


def prevails(num_shown: int, num_counted: int, least: int = MIN_INTERVENTIONS) -> bool:
    """Whether at least `least` count, and nearly all of them show it."""
    return num_counted >= least and 100 * num_shown >= SHARE_PERCENT * num_counted


def _prevails(shows: Mask, counts: Mask, least: int = MIN_INTERVENTIONS) -> bool:
    """Whether at least `least` interventions count, and nearly all of them show it."""
    return prevails(int((shows & counts).sum()), int(counts.sum()), least)


@rule("BD-RSP-001")
def actuators_act_in_their_direction(survey: Survey) -> Iterator[Check]:
    """More steering to the right moves the vehicle to the right, more throttle or less brake makes it faster.

    Of two actions, the one with more of a command responds more.
    """
    every = _responses(survey)
    keys = survey.descriptor.action_bank.keys if survey.descriptor else ()
    pairs = [(later, first, every.orders(later, first)) for later in range(len(keys)) for first in range(later)]
    found, examined = [], 0
    for column, agreement, orders, expected, in_order in (
        (
            "applied_steer",
            every.steering,
            [(keys[later], keys[first], turns) for later, first, (turns, _) in pairs],
            "a vehicle to the right of its nominal where it steers more to the right",
            "of two actions, the one that steers more to the right turns more to the right in the first second",
        ),
        (
            "applied_throttle",
            every.driving,
            [(keys[later], keys[first], drives) for later, first, (_, drives) in pairs],
            "a vehicle that is faster than its nominal with more throttle, less brake",
            "of two actions, the one with more throttle, less brake accelerates more at t_b + 5",
        ),
    ):
        counts = agreement != 0
        compared = [int((order != 0).sum()) for _, _, order in orders]
        examined += int(counts.sum()) >= MIN_INTERVENTIONS or max(compared, default=0) >= MIN_EQUAL
        reversed_pairs = [
            f"the contrary in {(order < 0).sum()} of {num_compared} groups with {later} and {first}"
            for (later, first, order), num_compared in zip(orders, compared, strict=True)
            if prevails(int((order < 0).sum()), num_compared, MIN_EQUAL)
        ]
        place: Location = {"table": "controls", "column": column}
        if _prevails(agreement < 0, counts):
            contrary = f"the contrary in {(agreement < 0).sum()} of {counts.sum()} interventions"
            found.append(Mismatch(place, expected, contrary))
        elif reversed_pairs:
            found.append(Mismatch(place, in_order, reversed_pairs[0], len(reversed_pairs)))
    yield Check.of(examined, found)


@rule("BD-RSP-002")
def commands_have_an_effect(survey: Survey) -> Iterator[Check]:
    """A policy whose commands differ from the nominal's, or from another's, changes what a moving vehicle does."""
    every, found, examined = _responses(survey), [], 0
    keys = survey.descriptor.action_bank.keys if survey.descriptor else ()
    for index, key in enumerate(keys):
        counts = every.is_commanded & (every.policy == index)
        unchanged = every.first == NO_RESPONSE
        examined += int(counts.sum()) >= MIN_EQUAL
        if _prevails(unchanged, counts, MIN_EQUAL):
            equal = (
                f"the nominal's observations, bit for bit, in {(unchanged & counts).sum()} of {counts.sum()} attempts"
            )
            found.append(Mismatch({"action_key": key}, "another future than the nominal's", equal))
        for other in range(index):
            compared, same = every.others(index, other)
            if _prevails(same, compared, MIN_EQUAL):
                equal = f"that of {keys[other]}, bit for bit, in {(same & compared).sum()} of {compared.sum()} groups"
                found.append(Mismatch({"action_key": key}, "a future of its own", equal))
                continue
            num_denied, num_told = every.denied(index, other) if (same & compared).any() else (0, 0)
            if num_denied >= MIN_EQUAL:
                equal = f"that of {keys[other]}, to the millimetre, in {num_denied} groups in which it gains speed"
                text = f"{equal}, as it does in none of {num_told} others, slower and faster ones among them"
                found.append(Mismatch({"action_key": key}, "a future of its own", text))
    yield Check.of(examined, found)


def _clean(every: Responses) -> Mask:
    """Commanded interventions that equal their nominal before the branch, and differ from it later."""
    is_clean: Mask = every.is_commanded & (every.first >= 0) & (every.first != NO_RESPONSE)
    return is_clean


@rule("BD-RSP-003")
def no_response_precedes_its_command(survey: Survey) -> Iterator[Check]:
    """The observation of the branch tick is taken before the control of that tick acts, accelerations included."""
    every = _responses(survey)
    clean, early = _clean(every), every.first == 0
    keys = survey.descriptor.action_bank.keys if survey.descriptor else ()
    counted = {key: clean & (every.policy == index) for index, key in enumerate(keys)}
    acting = [key for key, counts in counted.items() if _prevails(early, counts, MIN_EQUAL)]
    text = f"a difference in {(early & clean).sum()} of {clean.sum()} interventions that equal it before"
    found = Mismatch(
        {"table": "observations"}, "the nominal's observation at the branch tick, accelerations and yaw rate included",
        text + (f", nearly all of {', '.join(acting)}" if acting else ""),
    )  # fmt: skip
    judged, anticipated = every.is_anticipated
    effect = Mismatch(
        {"table": "observations", "column": "accel_longitudinal_mps2"},
        "at the branch tick the acceleration of the control before, as without the intervention",
        f"half its effect or more in {anticipated.sum()} of {judged.sum()} interventions that change it",
    )
    examined = sum(int(counts.sum()) >= MIN_EQUAL for counts in counted.values()) + int(
        judged.sum() >= MIN_INTERVENTIONS
    )
    if acting or _prevails(early, clean):
        yield Check.of(examined, [found])
    else:
        yield Check.of(examined, [effect] if _prevails(anticipated, judged) else ())


@rule("BD-RSP-004")
def responses_are_not_late(survey: Survey) -> Iterator[Check]:
    """Nearly all interventions should show first at the first observation after the branch."""
    every = _responses(survey)
    counts, late = _clean(every), _late(every)
    first = int(np.median(every.first[late])) if late.any() else 0
    found = (
        f"none yet in {late.sum()} of {counts.sum()} interventions; the median first is in that of t_b + {5 * first}"
    )
    mismatch = Mismatch({"table": "observations"}, "a response in the observation of t_b + 5", found)
    yield Check.of(int(counts.sum() >= MIN_INTERVENTIONS), [mismatch] if _prevails(late, counts) else ())


def _late(every: Responses) -> Mask:
    """Interventions that show first behind the first observation after the branch."""
    is_late: Mask = _clean(every) & (every.first > 1)
    return is_late


@rule("BD-RSP-014")
def images_show_responses_in_time(survey: Survey) -> Iterator[Check]:
    """The image of a first response is another one than the nominal's, where the camera can show as much."""
    cameras = sorted({camera for shard in survey.shards for camera in shard.sights})
    found, examined = [], 0
    for camera in cameras:
        every = Sights.of_all(shard.sights[camera] for shard in survey.shards if camera in shard.sights)
        counts = every.response_m >= every.resolved_m
        examined += int(counts.sum()) >= MIN_INTERVENTIONS
        if _prevails(every.is_hidden, counts):
            hidden = f"that of the nominal, byte for byte, in {(every.is_hidden & counts).sum()} of {counts.sum()}"
            text = f"{hidden} interventions that are {every.resolved_m:.2g} m away, which later images show"
            place: Location = {"table": "frames", "camera": camera}
            found.append(Mismatch(place, "an image of its own at the first response", text))
    yield Check.of(examined, found)


@rule("BD-RSP-005")
def groups_are_no_copies(survey: Survey) -> Iterator[Check]:
    """No attempt repeats, tick by tick, what the vehicle did in an attempt of another group."""
    every = [shard.tracks for shard in survey.shards]
    kept = last_rows(every)
    digests = np.concatenate([np.zeros(0, np.uint64), *(t.digest[own] for t, own in zip(every, kept, strict=True))])
    _, kind, times = np.unique(digests, return_inverse=True, return_counts=True)
    is_copied, start = times[kind] > 1, 0
    copies: dict[str, list[int]] = {}
    num_tracks: dict[str, int] = {}
    with_tracks = 0
    for tracks, own in zip(every, kept, strict=True):
        group = tracks.group[own]
        here = slice(start, start := start + len(group))
        with_tracks += len(np.unique(group))
        names = [*tracks.names] if is_copied[here].any() else []
        for place, digest in zip(group[is_copied[here]].tolist(), digests[here][is_copied[here]].tolist(), strict=True):
            copies.setdefault(names[place], []).append(digest)
            num_tracks[names[place]] = int((group == place).sum())
    home: dict[int, str] = {}
    for name in sorted(copies):
        for digest in copies[name]:
            home.setdefault(digest, name)
    found = []
    for name in sorted(copies):
        copied = [digest for digest in copies[name] if home[digest] != name]
        if copied:
            other = min(home[digest] for digest in copied)
            text = f"{len(copied)} of {num_tracks[name]} tracks, as in group {other!r}"
            found.append(Mismatch({"group_id": name}, "tracks that no other group has", text, len(copied)))
    yield Check.of(with_tracks if with_tracks > 1 else 0, found)


@rule("BD-RSP-015")
def groups_are_no_near_copies(survey: Survey) -> Iterator[Check]:
    """No group drives like another one among the same actors, wherever it is and whatever it is called."""
    every = [shard.outlines for shard in survey.shards if len(shard.outlines.group)]
    kept = last_rows(every)
    texts = [np.array([*o.names], object)[o.group[own]] for o, own in zip(every, kept, strict=True)]
    names = np.concatenate([np.zeros(0, object), *texts])
    values = np.concatenate([o.values[own] for o, own in zip(every, kept, strict=True)]) if every else np.zeros((0, 0))
    order = np.argsort(names)
    names, values = names[order], values[order]
    found: dict[str, str] = {}
    for one, other in _near_pairs(values, physical_bounds().copy_m):
        first, second = sorted((str(names[one]), str(names[other])))
        found[second] = min(first, found.get(second, first))
    text = f"those of group {{}}, within {physical_bounds().copy_m:g} m"
    yield Check.of(
        len(names) if len(names) > 1 else 0,
        [
            Mismatch({"group_id": second}, "ways and surroundings that no other group has", text.format(quote(first)))
            for second, first in sorted(found.items())
        ],
    )


def _near_pairs(outlines: NDArray[np.float64], reach: float) -> Iterator[tuple[int, int]]:
    """Pairs of rows that differ nowhere by more than a reach, where neither is NaN.

    Rows are sorted by the sum of the numbers that all of them have, and each is compared with the next few.
    """
    if len(outlines) < 2:
        return
    shared = outlines[:, np.isfinite(outlines).all(axis=0)]
    key = shared.sum(axis=1)
    order = np.argsort(key, kind="stable")
    for step in range(1, min(MOST_NEIGHBOURS, len(order) - 1) + 1):
        one, other = order[:-step], order[step:]
        may = np.flatnonzero(key[other] - key[one] <= reach * shared.shape[1])
        if not len(may):
            return
        differs = np.abs(outlines[one[may]] - outlines[other[may]]) > reach
        near = may[~differs.any(axis=1)]
        yield from zip(one[near].tolist(), other[near].tolist(), strict=True)


@rule("BD-RSP-006")
def motion_fits_in_most_attempts(survey: Survey) -> Iterator[Check]:
    """What nearly every attempt breaks is no accident of an attempt, but a frame, a unit or a clock."""
    found, examined = [], 0
    every = _responses(survey)
    is_late = _prevails(_late(every), _clean(every))
    lateness = "; responses are late, too (BD-RSP-004): observations may be recorded a stride late" if is_late else ""
    for rule_id, table in PHYSICAL.items():
        counts = [shard.judged[rule_id] for shard in survey.shards if rule_id in shard.judged]
        num_failed, num_examined = (sum(part) for part in zip(*counts, strict=True)) if counts else (0, 0)
        examined += num_examined >= MIN_INTERVENTIONS
        if prevails(num_failed, num_examined):
            text = f"{num_failed} of {num_examined} attempts that fail it{lateness}"
            found.append(Mismatch({"table": table}, f"{rule_id} ({CATALOGUE[rule_id].title}) in most attempts", text))
    yield Check.of(examined, found)


@rule("BD-RSP-007")
def motion_has_its_sign_unit_and_clock(survey: Survey) -> Iterator[Check]:
    """Speeds, yaw rates, accelerations and headings are, in most attempts, those of the positions and turns."""
    yield _calibrated(survey, QUANTITIES)


@rule("BD-RSP-016")
def ego_drives_as_the_declared_vehicle(survey: Survey) -> Iterator[Check]:
    """Steering and braking do, in most attempts, what they do to the vehicle that the descriptor declares."""
    yield _calibrated(survey, OF_VEHICLE)


def _calibrated(survey: Survey, quantities: Mapping[str, Quantity]) -> Check:
    """Check of quantities of which nearly all attempts have other values than those that are right."""
    found, examined = [], 0
    for name, quantity in quantities.items():
        values = np.concatenate([np.zeros(0), *(shard.calibration.get(name, ()) for shard in survey.shards)])
        is_wrong = (values < quantity.least) | (values > quantity.most)
        examined += len(values) >= MIN_INTERVENTIONS
        if _prevails(is_wrong, np.ones(len(values), bool)):
            median = float(np.median(values))
            unit = wrong_unit(name, median)
            meaning = f", as what is {unit.text}" if unit else ""
            text = f"{median:.3g} at the median{meaning}, and others in {is_wrong.sum()} of {len(values)} attempts"
            found.append(Mismatch({"table": quantity.table, "column": quantity.column}, quantity.expected, text))
    return Check.of(examined, found)


_FAULTS = ("one command from t_b to t_b + 49", "the nominal's commands", "the applied commands")
"""What an expert that is never asked seems to command, in the order of `Responses.expert`."""

_COMMANDED = {"expert_steer": ("steer",), "expert_throttle": ("throttle", "brake")}
"""Columns of findings on the expert, and the actuators that are judged there, in the order of `Responses.expert`."""


def _by_policy(survey: Survey, every: Responses, counts: Mask) -> Iterator[tuple[str, Mask]]:
    """The interventions that count, of each policy apart, with their name."""
    keys = survey.descriptor.action_bank.keys if survey.descriptor else ()
    for policy in np.unique(every.policy[counts]).tolist():
        yield f"interventions of {keys[policy]}", counts & (every.policy == policy)


def _takes(survey: Survey, every: Responses, actuators: Sequence[str]) -> Mask:
    """Interventions whose policy leaves not all of `actuators` to the expert, whose commands else are the applied."""
    policies = survey.descriptor.action_bank.policies if survey.descriptor else ()
    takes = [any(getattr(policy, name).rule != "online_expert" for name in actuators) for policy in policies]
    return np.array(takes, bool)[every.policy]


@rule("BD-RSP-010")
def expert_goes_on_while_it_is_overridden(survey: Survey) -> Iterator[Check]:
    """The expert's commands are those on the state of the intervention: no constant, no copy."""
    driver = survey.descriptor.driver if survey.descriptor else None
    if driver is not None and driver.kind == "log":
        return
    every, found, examined = _responses(survey), [], 0
    for index, (column, actuators) in enumerate(_COMMANDED.items()):
        counts, takes = every.is_overridden[index], _takes(survey, every, actuators)
        judged = (counts, counts, counts & takes)
        for who, own in (("interventions", counts), *_by_policy(survey, every, counts)):
            examined += int(own.sum()) >= MIN_INTERVENTIONS
            for fault, (text, of_fault) in enumerate(zip(_FAULTS, judged, strict=True), start=1):
                subjects = own & of_fault
                if _prevails(every.expert[:, index, fault], subjects):
                    expected = "commands on the state of the intervention, which is no longer the nominal's"
                    seen = f"{text} in nearly all of {subjects.sum()} {who}"
                    found.append(Mismatch({"table": "controls", "column": column}, expected, seen))
                    break
    yield Check.of(examined, found)
