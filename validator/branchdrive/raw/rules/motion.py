"""Motion rules: pose, speed, yaw rate and accelerations of the ego agree with each other within physical bounds.

Source: spec/05-raw-streams.md#motion, #contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.unit import wrong_unit
from branchdrive.files.survey import Survey
from branchdrive.raw.motion.calibration import calibration_between_contacts
from branchdrive.raw.motion.contact import is_free, knows_contacts, rest_observations, touches
from branchdrive.raw.motion.quantity import QUANTITIES, share_text, wrong_of_one
from branchdrive.raw.motion.residual import RELATIONS, Relation, displacement, turn
from branchdrive.raw.rules.responses import MIN_INTERVENTIONS, prevails
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import window_rows

_MIN_JUDGED = len(HISTORY_OFFSETS) // 2
"""Observations of a history at which motion has to be judged."""


_STRETCHES = ("over the whole drive", "up to the branch", "from the branch on")
"""What the parts of `calibration_between_contacts` are of, in words."""


class _Part(NamedTuple):
    """What a rule says of one column: who it can be compared in, and which observations are wrong."""

    column: str
    examined: Mask
    marked: Mask
    text: Callable[[int], tuple[str, str]]


def _check(view: ShardView, subjects: Mask, *parts: _Part) -> Check:
    """Check of the attempts in which a part can be compared, each described by its first observation that is wrong."""
    summary = view.observations.by_rollout(np.logical_or.reduce([part.marked for part in parts]))
    examined = np.logical_or.reduce([summary.any, *(part.examined for part in parts)])

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        part = next(part for part in parts if part.marked[row])
        place: Location = {"table": "observations", "column": part.column, "tick": int(view.observations.tick[row])}
        return Mismatch(place, *part.text(row), int(summary.count[i]))

    return Check.of_subjects(subjects & examined, subjects & summary.any, describe, summary.stretch)


def _judged(view: ShardView, relation: Relation, text: Callable[[Relation, int], tuple[str, str]]) -> _Part:
    """A relation where no contact keeps it from being judged.

    In an attempt whose contacts are not known, as many observations as one contact explains may break it.
    """
    observations, free = view.observations, view.cached(is_free)
    broken = relation.is_broken & free
    most = np.where(view.cached(knows_contacts), 0, rest_observations())
    is_wrong = np.append(observations.by_rollout(broken).count > most, False)
    compared = observations.by_rollout(relation.is_compared & free).any
    return _Part(relation.column, compared, broken & is_wrong[observations.rollout], lambda row: text(relation, row))


@rule("BD-MOT-001")
def displacement_agrees_with_speed(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The way between two observations is that of their speeds and headings."""

    def text(relation: Relation, row: int) -> tuple[str, str]:
        expected = f"a displacement within {relation.most[row]:.2f} m of what speed and heading give"
        return expected, f"{relation.residual[row]:.2f} m away from it"

    yield _check(view, subjects, _judged(view, view.cached(displacement), text))


@rule("BD-MOT-002")
def turn_agrees_with_yaw_rate(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The turn between two observations is that of their yaw rates."""

    def text(relation: Relation, row: int) -> tuple[str, str]:
        expected = f"a turn within {relation.most[row]:g} rad of what the yaw rate gives"
        return expected, f"{relation.residual[row]:.3f} rad away from it"

    yield _check(view, subjects, _judged(view, view.cached(turn), text))


@rule("BD-MOT-003")
def accelerations_are_of_the_past(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No acceleration and no yaw rate at tick 0; elsewhere accelerations agree with speeds and yaw rates.

    Zeros at tick 0 examine no attempt, since a world in which nothing is recorded has them too.
    """
    observations, parts = view.observations, []
    for column in ("accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps"):
        values = observations[column]

        def at_start(row: int, values: NDArray[np.float32] = values) -> tuple[str, str]:
            return "0 at tick 0, which has no past", f"{values[row]:g}"

        nobody = np.zeros(view.num_rollouts, bool)
        parts.append(_Part(column, nobody, (observations.tick == 0) & (values != 0), at_start))

    def later(relation: Relation, row: int) -> tuple[str, str]:
        expected = f"an acceleration within {relation.most[row]:g} m/s2 of what speed and yaw rate give"
        return expected, f"{relation.residual[row]:.1f} m/s2 away from it"

    relations = RELATIONS["BD-MOT-003"]
    yield _check(view, subjects, *parts, *(_judged(view, view.cached(relation), later) for relation in relations))


@rule("BD-MOT-004")
def histories_show_motion(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No attempt begins in contact, and contacts leave half of its history to be judged."""
    subjects = subjects & view.branched
    rollouts = np.flatnonzero(subjects)
    rows = window_rows(view, view.observations, rollouts, HISTORY_OFFSETS)
    num_judged = np.zeros(view.num_rollouts, np.int64)
    num_judged[rollouts] = (np.append(view.cached(is_free), False)[rows] & (rows >= 0)).sum(axis=1)
    touched = view.cached(touches)
    begins = view.observations.by_rollout(touched & (view.observations.tick == 0)).any
    first = view.observations.by_rollout(touched).first_row

    def describe(i: int) -> Mismatch:
        place: Location = {"table": "evidence", "column": "collision", "tick": int(view.observations.tick[first[i]])}
        if begins[i]:
            return Mismatch(place, "false at the start", "true")
        expected = f"{_MIN_JUDGED} observations of the history without a contact then or in the two seconds before"
        return Mismatch(place, expected, f"{num_judged[i]}")

    yield Check.of_subjects(subjects, subjects & (begins | (num_judged < _MIN_JUDGED)), describe)


@rule("BD-MOT-006")
def attempts_have_sign_unit_and_clock(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """Speeds, yaw rates, accelerations and headings of an attempt are those of its positions, turns and commands."""
    subjects = subjects & knows_contacts(view)
    values = view.cached(calibration_between_contacts)
    judged = [name for name, quantity in QUANTITIES.items() if quantity.of_one and name in values]
    wrong = {name: wrong_of_one(name, values[name]) for name in judged}
    compared = np.logical_or.reduce([np.isfinite(values[name]).any(axis=0) for name in judged])
    bad = np.logical_or.reduce([is_wrong.any(axis=0) for is_wrong in wrong.values()])

    def describe(i: int) -> Mismatch:
        names = [name for name, is_wrong in wrong.items() if is_wrong[:, i].any()]
        quantity, part = QUANTITIES[names[0]], int(wrong[names[0]][:, i].argmax())
        value = float(values[names[0]][part, i])
        unit = wrong_unit(names[0], value)
        meaning = f"as what is {unit.text}" if unit else share_text(names[0], value)
        place: Location = {"table": quantity.table, "column": quantity.column}
        expected = quantity.expected_of_stretch if part else quantity.expected_of_one
        found = ", ".join(filter(None, (f"{value:.3g}", meaning, _STRETCHES[part])))
        if others := "; ".join(QUANTITIES[name].text for name in names[1:]):
            found += f"; wrong too: {others}"
        return Mismatch(place, expected, found)

    yield Check.of_subjects(subjects & compared, subjects & bad, describe)


@rule("BD-MOT-005")
def most_attempts_have_no_contact(survey: Survey) -> Iterator[Check]:
    """A contact in nearly all attempts tells of a sensor that is always on, and leaves little to be judged."""
    counts = [shard.in_contact for shard in survey.shards]
    num_touched, num_all = (sum(part) for part in zip(*counts, strict=True)) if counts else (0, 0)
    mismatch = Mismatch(
        {"table": "evidence", "column": "collision"}, "attempts without a contact, too",
        f"a contact in {num_touched} of {num_all} attempts",
    )  # fmt: skip
    yield Check.of(int(num_all >= MIN_INTERVENTIONS), [mismatch] if prevails(num_touched, num_all) else ())
