"""Leakage rules: the audit was made of this release, its verdicts follow from its numbers, and structure tells nothing.

Source: paper VI-A; spec/13-leakage.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.layout import LEAKAGE_FILE
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import CONTROL_WINDOW
from branchdrive.driving.target import TARGETS
from branchdrive.layers.compare import document_check, shown
from branchdrive.layers.view import ReleaseView
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.replays import replay_inputs
from branchdrive.leakage.structural import ALPHA, MAX_CORRELATION, Telltale, held_targets, neighbours_p, ranked_targets
from branchdrive.leakage.verify import (
    battery_differences,
    count_differences,
    gate_differences,
    input_differences,
    protocol_differences,
    score_differences,
    statistic_differences,
)
from branchdrive.model.rules import FEATURES, model_arrays

Targets: TypeAlias = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Values ``[groups, actions, targets]``, 0 where not available, and whether they are."""


def _audit(view: ReleaseView) -> dict[str, Any] | None:
    """Results of the leakage audit; ``None`` where the release has none and claims nothing."""
    if LEAKAGE_FILE not in view.files:
        return None
    document: dict[str, Any] = view.document(LEAKAGE_FILE)
    return document


def _found(examined: int, problems: Iterable[tuple[str, object, object]]) -> Check:
    mismatches = (
        Mismatch({"pointer": pointer or "/"}, _words(expected), _words(found)) for pointer, expected, found in problems
    )
    return document_check(LEAKAGE_FILE, examined, mismatches)


def _words(value: object) -> str:
    """Text as it is, anything else as a cell."""
    return value if isinstance(value, str) else shown(value)


def _recomputed(view: ReleaseView) -> ReplayInputs:
    try:
        return replay_inputs(view.extract["replays"], view.frame("group_quality"), view.descriptor.action_bank)
    except ValueError as error:
        raise PreconditionError(f"inputs of the leakage audit: {error}") from error


@rule("BD-LKG-001")
def audit_is_of_the_core_valid_groups(view: ReleaseView) -> Iterator[Check]:
    """Groups of the audit, by partition, are the core-valid ones; its parts speak of the same groups."""
    if (audit := _audit(view)) is None:
        return
    groups = view.frame("group_quality")
    valid = np.asarray(groups["core_valid"], bool)
    counts = dict(sorted(Counter(np.ma.filled(groups["partition"], "")[valid].tolist()).items()))
    mismatches = document_mismatches(counts, audit["inputs"]["num_groups"], pointer="/inputs/num_groups")
    problems = [(str(found.location["pointer"]), found.expected, found.found) for found in mismatches]
    yield _found(len(counts), [*problems, *count_differences(audit)])


@rule("BD-LKG-002")
def audit_inputs_recompute(view: ReleaseView) -> Iterator[Check]:
    """What the audit saw is what raw says about replays before the branch, in the stored groups and partitions."""
    if (audit := _audit(view)) is not None:
        inputs = view.once(_recomputed)
        groups_apart = {"/inputs/num_groups"}  # the matter of another rule
        problems = [d for d in input_differences(audit, inputs) if not d.pointer.startswith(tuple(groups_apart))]
        yield _found(inputs.num_groups, problems)


@rule("BD-LKG-003")
def gate_statistics_recompute(view: ReleaseView) -> Iterator[Check]:
    """Statistics, places, p-values and effect size of the gate; permutations are drawn again as far as they decide."""
    if (audit := _audit(view)) is not None:
        inputs = _audited(view, audit)
        yield _found(max(1, len(audit["gate"]["tests"])), _judged(statistic_differences, audit, inputs))


def _audited(view: ReleaseView, audit: dict[str, Any]) -> ReplayInputs:
    """Inputs of an audit, where they are those that recompute and its protocol bounds the work.

    Raises:
        PreconditionError: They are not.
    """
    inputs = view.once(_recomputed)
    if inputs.digest() != audit["inputs"]["digest"]:
        raise PreconditionError("the leakage audit saw other inputs")
    if protocol_differences(audit):
        raise PreconditionError("the leakage audit followed another protocol")
    if count_differences(audit):
        raise PreconditionError("parts of the leakage audit are of other groups")
    return inputs


def _judged(judge: Any, *arguments: Any) -> list[tuple[str, object, object]]:
    try:
        return list(judge(*arguments))
    except ValueError as error:
        return [("/protocol", "numbers within their ranges", str(error))]


@rule("BD-LKG-004")
def gate_verdict_follows(view: ReleaseView) -> Iterator[Check]:
    """Holm's procedure and alpha give the adjusted p-values and the verdict."""
    if (audit := _audit(view)) is not None:
        yield _found(max(1, len(audit["gate"]["tests"])), _judged(gate_differences, audit))


@rule("BD-LKG-005")
def battery_statuses_follow(view: ReleaseView) -> Iterator[Check]:
    """Chance, controls and the rule of identical scores give the statuses of the battery."""
    if (audit := _audit(view)) is not None:
        examined = sum(len(way["controls"]) + len(way["tests"]) for way in audit["battery"]["ways"])
        yield _found(examined, _judged(battery_differences, audit))


@rule("BD-LKG-007")
def gate_passes(view: ReleaseView) -> Iterator[Check]:
    """The gate's verdict is a pass."""
    if (audit := _audit(view)) is not None:
        verdict = audit["gate"]["verdict"]
        yield _found(1, [] if verdict == "pass" else [("/gate/verdict", "pass", verdict)])


@rule("BD-LKG-008")
def identifiers_do_not_tell_the_partition(view: ReleaseView) -> Iterator[Check]:
    """Neighbours in the order of group ids share a partition no more often than chance has it."""
    groups = view.frame("group_quality")
    homes = dict(zip(groups["group_id"].tolist(), np.ma.filled(groups["partition"], "").tolist(), strict=True))
    ordered = [homes[group] for group in sorted(homes) if homes[group]]
    p = neighbours_p(ordered) if len(ordered) > 1 else 1.0
    place: Location = {
        "file": "quality/group_quality.parquet",
        "table": "group_quality",
        "column": "group_id",
    }
    told = [Mismatch(place, f"p above {ALPHA:g} that order and partition are unrelated", f"p = {p:.2g}")]
    yield Check.of(int(len(ordered) > 1), told if p <= ALPHA else [])


def _history_variables(view: ReleaseView) -> tuple[NDArray[np.float64], list[str], Targets]:
    """Sensor histories as variables ``[groups, variables]``, their names, and the scalar targets."""
    arrays = view.once(model_arrays)
    size = len(arrays.groups)
    variables = np.concatenate([arrays.state.reshape(size, -1), arrays.controls.reshape(size, -1)], axis=1)
    names = [f"state {f.name} at tick {offset}" for offset in HISTORY_OFFSETS for f in SENSOR_PROFILE.state]
    names += [f"past_controls {f.name} at tick {offset}" for offset in CONTROL_WINDOW for f in SENSOR_PROFILE.controls]
    available = arrays.scalars.available
    return variables, names, (np.where(available, arrays.scalars.values, 0.0), available)


def _told(expected: str, names: list[str], found: list[Telltale]) -> Check:
    sightings = [
        Mismatch(
            {"file": FEATURES, "column": names[t.variable]}, expected, f"{t.how} of the target {TARGETS[t.target].name}"
        )
        for t in found
    ]
    return Check.of(len(names), sightings)


@rule("BD-LKG-009")
def no_history_variable_ranks_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history ranks a target by itself."""
    variables, names, targets = view.once(_history_variables)
    yield _told(f"a correlation of at most {MAX_CORRELATION:g}", names, ranked_targets(variables, *targets))


@rule("BD-LKG-010")
def no_history_variable_holds_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history is an affine function of a target of one action."""
    variables, names, targets = view.once(_history_variables)
    yield _told("values of its own", names, held_targets(variables, *targets))


@rule("BD-LKG-011")
def protocol_is_the_specification_s(view: ReleaseView) -> Iterator[Check]:
    """Numbers of gate and battery are the specification's constants, exactly."""
    if (audit := _audit(view)) is not None:
        examined = sum(len(audit["protocol"][part]) for part in ("gate", "parity"))
        yield _found(examined, protocol_differences(audit))


@rule("BD-LKG-012")
def battery_scores_recompute(view: ReleaseView) -> Iterator[Check]:
    """Scores of controls and regressions of the battery; the recurrent tests are not repeated."""
    if (audit := _audit(view)) is not None:
        inputs = _audited(view, audit)
        examined = sum(len(way["controls"]) + len(way["tests"]) for way in audit["battery"]["ways"])
        yield _found(examined, _judged(score_differences, audit, inputs))
