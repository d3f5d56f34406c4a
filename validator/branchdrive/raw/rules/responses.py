"""Response rules: what the interventions of the whole dataset do refutes, or does not, what its descriptor declares.

One attempt proves little, since a vehicle may stand, slide or touch; what holds of nearly all of them is no accident.
Source: spec/07-rules.md#response.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import CATALOGUE, rule
from branchdrive.driving.response import NO_RESPONSE, Responses
from branchdrive.files.survey import Survey
from branchdrive.raw.calibration import QUANTITIES

MIN_INTERVENTIONS = 8
"""Interventions, attempts or tracks below which nothing is concluded; nine in ten of fewer is all of them."""

MIN_EQUAL = 3
"""Futures equal bit for bit under other commands that are no accident, if nearly all of a policy are."""

PHYSICAL = {
    "BD-RTE-001": "observations",
    "BD-RTE-003": "observations",
    "BD-MOT-001": "observations",
    "BD-MOT-002": "observations",
    "BD-MOT-003": "observations",
    "BD-ACT-004": "actors",
}
"""Rules that nearly all attempts of a collector with a wrong frame, unit or clock fail, and their tables."""

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
    """More steering to the right moves the vehicle to the right, more throttle or less brake makes it faster."""
    every = _responses(survey)
    found, examined = [], 0
    for column, agreement, expected in (
        (
            "applied_steer",
            every.steering,
            "a vehicle to the right of its nominal where it steers more to the right",
        ),
        ("applied_throttle", every.driving, "a vehicle that is faster than its nominal with more throttle, less brake"),
    ):
        counts = agreement != 0
        examined += int(counts.sum()) >= MIN_INTERVENTIONS
        if _prevails(agreement < 0, counts):
            contrary = f"the contrary in {(agreement < 0).sum()} of {counts.sum()} interventions"
            found.append(Mismatch({"table": "controls", "column": column}, expected, contrary))
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
    counts, late = _clean(every), every.first > 1
    first = int(np.median(every.first[late & counts])) if (late & counts).any() else 0
    found = f"none before that of t_b + {5 * first} in most of {(late & counts).sum()} of {counts.sum()} interventions"
    mismatch = Mismatch({"table": "observations"}, "a response in the observation of t_b + 5", found)
    yield Check.of(int(counts.sum() >= MIN_INTERVENTIONS), [mismatch] if _prevails(late, counts) else ())


@rule("BD-RSP-005")
def groups_are_no_copies(survey: Survey) -> Iterator[Check]:
    """No attempt repeats, tick by tick, what the vehicle did in an attempt of another group."""
    groups = {group_id: digests for shard in survey.shards for group_id, digests in shard.tracks.items()}
    times = Counter(digest for digests in groups.values() for digest in digests)
    home: dict[int, str] = {}
    for group_id in sorted(groups):
        for digest in groups[group_id]:
            home.setdefault(digest, group_id)
    found = []
    for group_id in sorted(groups):
        copied = [digest for digest in groups[group_id] if times[digest] > 1 and home[digest] != group_id]
        if copied:
            other = min(home[digest] for digest in copied)
            text = f"{len(copied)} of {len(groups[group_id])} tracks, as in group {other!r}"
            found.append(Mismatch({"group_id": group_id}, "tracks that no other group has", text, len(copied)))
    yield Check.of(len(groups), found)


@rule("BD-RSP-006")
def motion_fits_in_most_attempts(survey: Survey) -> Iterator[Check]:
    """What nearly every attempt breaks is no accident of an attempt, but a frame, a unit or a clock."""
    found, examined = [], 0
    for rule_id, table in PHYSICAL.items():
        counts = [shard.judged[rule_id] for shard in survey.shards if rule_id in shard.judged]
        num_failed, num_examined = (sum(part) for part in zip(*counts, strict=True)) if counts else (0, 0)
        examined += num_examined >= MIN_INTERVENTIONS
        if prevails(num_failed, num_examined):
            text = f"{num_failed} of {num_examined} attempts that fail it"
            found.append(Mismatch({"table": table}, f"{rule_id} ({CATALOGUE[rule_id].title}) in most attempts", text))
    yield Check.of(examined, found)


@rule("BD-RSP-007")
def motion_has_its_sign_unit_and_clock(survey: Survey) -> Iterator[Check]:
    """Speeds, yaw rates, accelerations and headings are, in most attempts, those of the positions and turns."""
    found, examined = [], 0
    for name, quantity in QUANTITIES.items():
        values = np.concatenate([shard.calibration.get(name, np.zeros(0)) for shard in survey.shards] or [np.zeros(0)])
        is_wrong = (values < quantity.least) | (values > quantity.most)
        examined += len(values) >= MIN_INTERVENTIONS
        if _prevails(is_wrong, np.ones(len(values), bool)):
            expected = f"{quantity.text}: {quantity.least:g} to {quantity.most:g}"
            text = f"{np.median(values):.3g} at the median, and others in {is_wrong.sum()} of {len(values)} attempts"
            found.append(Mismatch({"table": quantity.table, "column": quantity.column}, expected, text))
    yield Check.of(examined, found)
