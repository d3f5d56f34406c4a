"""Leakage rules: the audit was made of this release, its verdicts follow from its numbers, and structure tells nothing.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md.
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
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.recompute import input_mismatches, score_mismatches, statistic_mismatches
from branchdrive.leakage.replays import replay_inputs
from branchdrive.leakage.structural import (
    ALPHA,
    MAX_CORRELATION,
    MAX_OUTCOME_CORRELATION,
    TargetLeak,
    affine_targets,
    neighbours_p,
    ranked_targets,
    revealed_outcomes,
)
from branchdrive.leakage.verify import (
    battery_mismatches,
    count_mismatches,
    gate_mismatches,
    protocol_mismatches,
    value_mismatches,
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


def _found(examined: int, mismatches: Iterable[Mismatch]) -> Check:
    """Check of the document of the audit; numbers out of range leave nothing to compute with."""
    try:
        found = list(mismatches)
    except ValueError as error:
        found = [Mismatch({"pointer": "/protocol"}, "numbers within their ranges", str(error))]
    return document_check(LEAKAGE_FILE, examined, found)


def _recomputed(view: ReleaseView) -> ReplayInputs:
    try:
        return replay_inputs(view.raw_rows["replays"], view.frame("group_quality"), view.descriptor)
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
    of_inputs = document_mismatches(counts, audit["inputs"]["num_groups"], pointer="/inputs/num_groups")
    yield _found(len(counts), [*of_inputs, *count_mismatches(audit)])


@rule("BD-LKG-002")
def audit_inputs_recompute(view: ReleaseView) -> Iterator[Check]:
    """What the audit saw is what raw says about replays before the branch, in the stored groups and partitions."""
    if (audit := _audit(view)) is not None:
        inputs = view.cached(_recomputed)
        found = input_mismatches(audit, inputs)
        # Another rule checks the numbers of groups.
        yield _found(
            inputs.num_groups, (m for m in found if not str(m.location["pointer"]).startswith("/inputs/num_groups"))
        )


@rule("BD-LKG-003")
def gate_statistics_recompute(view: ReleaseView) -> Iterator[Check]:
    """Statistics, places, p-values and effect size of the gate; permutations are drawn again as far as they decide."""
    if (audit := _audit(view)) is not None:
        inputs = _audited(view, audit)
        yield _found(max(1, len(audit["gate"]["tests"])), statistic_mismatches(audit, inputs))


def _audited(view: ReleaseView, audit: dict[str, Any]) -> ReplayInputs:
    """Inputs of an audit, where they are those that recompute and its protocol bounds the work.

    Raises:
        PreconditionError: They are not.
    """
    inputs = view.cached(_recomputed)
    if inputs.digest() != audit["inputs"]["digest"]:
        raise PreconditionError("the leakage audit saw other inputs")
    if any(protocol_mismatches(audit)):
        raise PreconditionError("the leakage audit followed another protocol")
    if any(count_mismatches(audit)):
        raise PreconditionError("parts of the leakage audit are of other groups")
    return inputs


@rule("BD-LKG-004")
def gate_verdict_follows(view: ReleaseView) -> Iterator[Check]:
    """Holm's procedure and alpha give the adjusted p-values and the verdict."""
    if (audit := _audit(view)) is not None:
        yield _found(max(1, len(audit["gate"]["tests"])), gate_mismatches(audit))


@rule("BD-LKG-005")
def battery_statuses_follow(view: ReleaseView) -> Iterator[Check]:
    """Chance, controls and the rule of identical scores give the statuses of the battery."""
    if (audit := _audit(view)) is not None:
        examined = sum(len(way["controls"]) + len(way["tests"]) for way in audit["battery"]["ways"])
        yield _found(examined, battery_mismatches(audit))


@rule("BD-LKG-007")
def gate_passes(view: ReleaseView) -> Iterator[Check]:
    """The gate's verdict is a pass."""
    if (audit := _audit(view)) is not None:
        verdict = audit["gate"]["verdict"]
        yield _found(1, value_mismatches("/gate/verdict", "pass", verdict))


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
    mismatches = [Mismatch(place, f"p above {ALPHA:g} that order and partition are unrelated", f"p = {p:.2g}")]
    yield Check.of(int(len(ordered) > 1), mismatches if p <= ALPHA else [])


def _history_variables(view: ReleaseView) -> tuple[NDArray[np.float64], list[str], Targets]:
    """Sensor histories as variables ``[groups, variables]``, their names, and the scalar targets."""
    arrays = view.cached(model_arrays)
    size = len(arrays.groups)
    variables = np.concatenate([arrays.state.reshape(size, -1), arrays.controls.reshape(size, -1)], axis=1)
    names = [f"state {f.name} at tick {offset}" for offset in HISTORY_OFFSETS for f in SENSOR_PROFILE.state]
    names += [f"past_controls {f.name} at tick {offset}" for offset in CONTROL_WINDOW for f in SENSOR_PROFILE.controls]
    is_recorded = np.isfinite(variables).any(axis=0)
    variables, names = variables[:, is_recorded], [name for name, kept in zip(names, is_recorded, strict=True) if kept]
    available = arrays.scalars.available
    return variables, names, (np.where(available, arrays.scalars.values, 0.0), available)


def _target_check(expected: str, names: list[str], found: list[TargetLeak]) -> Check:
    mismatches = [
        Mismatch(
            {"file": FEATURES, "column": names[t.variable]}, expected, f"{t.how} of the target {TARGETS[t.target].name}"
        )
        for t in found
    ]
    return Check.of(len(names), mismatches)


@rule("BD-LKG-009")
def no_history_variable_ranks_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history ranks a target by itself."""
    variables, names, targets = view.cached(_history_variables)
    yield _target_check(f"a correlation of at most {MAX_CORRELATION:g}", names, ranked_targets(variables, *targets))


@rule("BD-LKG-010")
def no_history_variable_holds_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history is an affine function of a target of one action."""
    variables, names, targets = view.cached(_history_variables)
    yield _target_check("no affine function of a target", names, affine_targets(variables, *targets))


@rule("BD-LKG-011")
def protocol_is_the_specification_s(view: ReleaseView) -> Iterator[Check]:
    """Numbers of gate and battery are the specification's constants, exactly."""
    if (audit := _audit(view)) is not None:
        examined = sum(len(audit["protocol"][part]) for part in ("gate", "parity"))
        yield _found(examined, protocol_mismatches(audit))


@rule("BD-LKG-012")
def battery_scores_recompute(view: ReleaseView) -> Iterator[Check]:
    """Scores of controls and regressions of the battery; the recurrent tests are not repeated."""
    if (audit := _audit(view)) is not None:
        inputs = _audited(view, audit)
        examined = sum(len(way["controls"]) + len(way["tests"]) for way in audit["battery"]["ways"])
        yield _found(examined, score_mismatches(audit, inputs))


@rule("BD-LKG-013")
def no_history_variable_tells_an_outcome(view: ReleaseView) -> Iterator[Check]:
    """No state of a sensor history ranks an outcome of one action, or what the actions of a group came to."""
    variables, names, targets = view.cached(_history_variables)
    is_state = [name.startswith("state ") for name in names]
    variables, names = variables[:, is_state], [name for name in names if name.startswith("state ")]
    columns = [name.partition(" at tick ")[0] for name in names]
    expected = f"a correlation of at most {MAX_OUTCOME_CORRELATION:g}, of a place at most {MAX_CORRELATION:g}"
    yield _target_check(expected, names, revealed_outcomes(variables, columns, *targets))
