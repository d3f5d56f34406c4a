"""Quality rules: compliance, completeness, eligibility and counts recompute.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/10-layers.md#quality.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.mismatch import Check, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.errors import UsageError
from branchdrive.layers.compare import columns_agree, document_check, place, place_in_table, rows_agree
from branchdrive.layers.view import ReleaseView
from branchdrive.quality.population import population_document
from branchdrive.quality.variants import declared_of, variants_document

POPULATION = "quality/population.json"
VARIANTS = "quality/variants.json"
STAGES = ("exact_bank", "controls_valid", "integrity_complete", "eligible")


@rule("BD-QUA-001")
def attempts_have_quality(view: ReleaseView) -> Iterator[Check]:
    """One row for every attempt of the raw layer, and no other."""
    yield from rows_agree(view, "attempt_quality")


@rule("BD-QUA-002")
def compliance_recomputes(view: ReleaseView) -> Iterator[Check]:
    """Whether an attempt complies, and the rules that it fails."""
    yield from columns_agree(view, "attempt_quality", ("compliant", "fails", "failed_rules"))


@rule("BD-QUA-003")
def completeness_recomputes(view: ReleaseView) -> Iterator[Check]:
    """Rows that are missing of each window."""
    windows = ("history_controls", "history_observations", "future_controls", "future_observations", "evidence")
    columns = ("group_id", "has_branch", *(f"missing_{name}" for name in windows))
    yield from columns_agree(view, "attempt_quality", columns)


@rule("BD-QUA-004")
def modalities_recompute(view: ReleaseView) -> Iterator[Check]:
    """Whether an attempt has actors, evidence and media."""
    yield from columns_agree(view, "attempt_quality", ("has_actors", "has_evidence", "has_media"))


@rule("BD-QUA-005")
def groups_have_quality(view: ReleaseView) -> Iterator[Check]:
    """One row for every branch group of the raw layer, and no other."""
    yield from rows_agree(view, "group_quality")


@rule("BD-QUA-006")
def stages_recompute(view: ReleaseView) -> Iterator[Check]:
    """How far a group gets."""
    yield from columns_agree(view, "group_quality", STAGES)


@rule("BD-QUA-007")
def reasons_recompute(view: ReleaseView) -> Iterator[Check]:
    """The rules that cost a group the stage at which it is lost, where it is lost indeed."""
    expected, found, pairs = view.expected("group_quality"), view.frame("group_quality"), view.aligned("group_quality")
    lost = np.asarray(expected["lost"][pairs.expected] & found["lost"][pairs.found], bool)
    yield from columns_agree(view, "group_quality", ("lost_rules",), where=lost)


@rule("BD-QUA-008")
def context_repeats_the_raw_layer(view: ReleaseView) -> Iterator[Check]:
    """Scenario type, town and route of a group."""
    yield from columns_agree(view, "group_quality", ("scenario_type", "town", "route_id"))


@rule("BD-QUA-009")
def nominal_replays_recompute(view: ReleaseView) -> Iterator[Check]:
    """Compliant nominal replays of a group."""
    yield from columns_agree(view, "group_quality", ("num_nominal_replays",))


@rule("BD-QUA-010")
def stages_follow_each_other(view: ReleaseView) -> Iterator[Check]:
    """A group that reaches a stage reached those before it, and one that reaches them all is not lost."""
    groups = view.frame("group_quality")
    flags = np.stack([groups[name] for name in STAGES], axis=1)
    skipped = (flags[:, 1:] & ~flags[:, :-1]).any(axis=1)
    bad = np.flatnonzero(skipped | (groups["lost"] == groups["eligible"]))

    def mismatch(row: int) -> Mismatch:
        reached = ", ".join(name for name, flag in zip(STAGES, flags[row], strict=True) if flag) or "no stage"
        lost = "lost" if groups["lost"][row] else "not lost"
        where = place(view, "group_quality", groups, row)
        return Mismatch(where, "stages in order, lost exactly where not eligible", f"{reached}; {lost}")

    yield Check(len(flags), bad, mismatch)


@rule("BD-QUA-011")
def population_recomputes(view: ReleaseView) -> Iterator[Check]:
    """Groups and trajectories at each stage, by partition."""
    document = view.document(POPULATION)
    num_policies = len(view.descriptor.action_bank.policies)
    expected = population_document(view.frame("group_quality"), num_policies=num_policies)
    yield document_check(POPULATION, len(expected["stages"]), document_mismatches(expected, document))


@rule("BD-QUA-012")
def variants_recompute(view: ReleaseView) -> Iterator[Check]:
    """Numbers and digests of the frozen population and of every declared variant."""
    document, groups = view.document(VARIANTS), view.frame("group_quality")
    examined = 1 + len(document["variants"])
    try:
        expected = variants_document(groups, declared_of(document))
    except UsageError as error:
        undeclarable = Mismatch({"pointer": "/variants"}, "variants that can be declared", str(error))
        yield document_check(VARIANTS, examined, [undeclarable])
        return
    yield document_check(VARIANTS, examined, document_mismatches(expected, document))


@rule("BD-QUA-013")
def layers_list_the_same(view: ReleaseView) -> Iterator[Check]:
    """Attempts and groups of the quality layer are those of the canonical layer.

    Where the raw layer is available, each list is compared with it, and what differs from it is not reported again.
    """
    for canonical, quality, key in (
        ("attempts", "attempt_quality", "rollout_id"),
        ("records", "group_quality", "group_id"),
    ):
        left, right = (set(view.frame(name)[key].tolist()) for name in (canonical, quality))
        differing = left ^ right if view.raw.rows is None else set()
        mismatches = [
            Mismatch(
                {**place_in_table(view, quality), key: value},
                f"in {canonical} and {quality}",
                f"in {canonical if value in left else quality} alone",
            )
            for value in sorted(differing)
        ]  # fmt: skip
        yield Check.of(len(left), mismatches)
