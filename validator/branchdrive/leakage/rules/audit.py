"""Leakage rules on the audit: it was made of this release, and its verdicts follow from its numbers.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.layout import LEAKAGE_FILE
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView
from branchdrive.leakage.inputs import ReplayInputs
from branchdrive.leakage.recompute import input_mismatches, score_mismatches, statistic_mismatches
from branchdrive.leakage.replays import collected_inputs, core_valid_homes
from branchdrive.leakage.verify import (
    battery_mismatches,
    count_mismatches,
    gate_mismatches,
    protocol_mismatches,
    value_mismatches,
)


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
        replays, groups = view.raw_shards("replays"), view.frame("group_quality")
        return collected_inputs(replays, core_valid_homes(groups), view.descriptor)
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
