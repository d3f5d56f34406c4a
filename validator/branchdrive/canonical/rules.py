"""Canonical rules: one record for each group and action, chosen by rule, and nothing unexplained.

Source: paper, "Release Structure"; spec/10-layers.md#canonical.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from branchdrive.canonical.record import policy_columns, source_counts, sum_of_counts
from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.layout import SOURCE_FILE
from branchdrive.contract.mismatch import Check, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.layers.compare import columns_agree, document_check, format_cell, place, place_in_table, rows_agree
from branchdrive.layers.view import ReleaseView
from branchdrive.tables.frame import distinct

_REPEATED = (
    "attempt", "protocol_variant", "scenario_type", "town", "route_id", "seed", "repetition", "branched",
    "branch_tick", "branch_frame", "shard", "provenance",
)  # fmt: skip

_STANDS = ("selected", "kept")
"""Dispositions of attempts that stand for their action."""


@rule("BD-CAN-001")
def records_cover_groups_and_actions(view: ReleaseView) -> Iterator[Check]:
    """One record for each group of the raw layer and action of the bank."""
    yield from rows_agree(view, "records")


@rule("BD-CAN-002")
def records_name_the_canonical_choice(view: ReleaseView) -> Iterator[Check]:
    """The attempt of a record is the one that the canonical choice gives."""
    yield from columns_agree(view, "records", ("present", "rollout_id"))


@rule("BD-CAN-003")
def record_states_recompute(view: ReleaseView) -> Iterator[Check]:
    """Selected where the attempt complies, ineligible where it does not, missing where there is none."""
    yield from columns_agree(view, "records", ("state",))


@rule("BD-CAN-004")
def nominal_entries_are_links(view: ReleaseView) -> Iterator[Check]:
    """The record of the nominal action is a link to the nominal rollout; every other one is physical."""
    records, bank = view.frame("records"), view.descriptor.action_bank
    nominal = records["action_key"] == bank.nominal.key
    expected = np.where(nominal, "nominal_link", "physical")
    linked = ~(records["present"] & nominal) | (
        np.ma.filled(records["nominal_rollout_id"], "") == np.ma.filled(records["rollout_id"], "")
    )
    bad = np.flatnonzero((records["kind"] != expected) | ~linked)

    def mismatch(row: int) -> Mismatch:
        if records["kind"][row] != expected[row]:
            return Mismatch(
                place(view, "records", records, row, "kind"),
                format_cell(expected[row]),
                format_cell(records["kind"][row]),
            )
        where = place(view, "records", records, row, "nominal_rollout_id")
        return Mismatch(where, format_cell(records["rollout_id"][row]), format_cell(records["nominal_rollout_id"][row]))

    yield Check(len(expected), bad, mismatch)


@rule("BD-CAN-005")
def interventions_share_their_nominal(view: ReleaseView) -> Iterator[Check]:
    """The nominal of a selected intervention is the rollout that the group's link record names."""
    records, bank = view.frame("records"), view.descriptor.action_bank
    nominal = records["action_key"] == bank.nominal.key
    own = np.ma.filled(records["rollout_id"], "")
    links = dict(zip(records["group_id"][nominal].tolist(), own[nominal].tolist(), strict=True))
    rows = np.flatnonzero(~nominal & (records["state"] == "selected"))
    named = np.ma.filled(records["nominal_rollout_id"], "")
    bad = [row for row in rows.tolist() if named[row] != links.get(records["group_id"][row], "")]
    yield Check.of(
        len(rows),
        [
            Mismatch(
                place(view, "records", records, row, "nominal_rollout_id"),
                format_cell(links.get(records["group_id"][row]) or None),
                format_cell(named[row] or None),
            )
            for row in bad
        ],
    )


@rule("BD-CAN-006")
def records_repeat_their_attempt(view: ReleaseView) -> Iterator[Check]:
    """Route, scenario, seed, branch, shard and provenance are those of the attempt."""
    expected, found, pairs = view.expected("records"), view.frame("records"), view.aligned("records")
    same = (
        np.ma.filled(expected["rollout_id"], "")[pairs.expected] == np.ma.filled(found["rollout_id"], "")[pairs.found]
    )
    yield from columns_agree(view, "records", _REPEATED, where=same)
    # Where the nominal is not the group's own, which others judge, it is at least the one that raw names.
    kept = same & (found["state"][pairs.found] == "ineligible") & (found["kind"][pairs.found] == "physical")
    yield from columns_agree(view, "records", ("nominal_rollout_id",), where=kept)


@rule("BD-CAN-007")
def records_state_control_semantics(view: ReleaseView) -> Iterator[Check]:
    """Family, magnitude, duration, rules and recovery of a record are those of the bank's policy.

    A record of another action is one too many, which is not reported again where the raw layer is available.
    """
    records, policies = view.frame("records"), policy_columns(view.descriptor.action_bank)
    row_of = {key: row for row, key in enumerate(policies["action_key"].tolist())}
    at = np.array([row_of.get(key, -1) for key in records["action_key"].tolist()], np.int64)
    columns = [name for name in policies if name != "action_key"]
    unknown = at < 0
    wrong = unknown & (view.raw.rows is None)
    differing = np.stack([((records[name] != policies[name][at]) & ~unknown) | wrong for name in columns], axis=1)
    bad = np.flatnonzero(differing.any(axis=1))

    def mismatch(row: int) -> Mismatch:
        column = columns[int(np.argmax(differing[row]))]
        wanted = format_cell(policies[column][at[row]]) if at[row] >= 0 else "an action of the bank"
        return Mismatch(place(view, "records", records, row, column), wanted, format_cell(records[column][row]))

    yield Check(len(at), bad, mismatch)


@rule("BD-CAN-008")
def attempts_are_listed(view: ReleaseView) -> Iterator[Check]:
    """Every attempt of the raw layer has one row, and no other has one."""
    yield from rows_agree(view, "attempts")


@rule("BD-CAN-009")
def attempts_repeat_the_raw_layer(view: ReleaseView) -> Iterator[Check]:
    """Group, role, action, attempt number, variant and status are those of the raw layer."""
    columns = ("group_id", "role", "action_key", "attempt", "protocol_variant", "status")
    yield from columns_agree(view, "attempts", columns)


@rule("BD-CAN-010")
def dispositions_recompute(view: ReleaseView) -> Iterator[Check]:
    """What became of an attempt that stands for no action follows from its status, its compliance and the choice.

    Other rules check the choice itself, and that it is listed as such.
    """
    expected, found, pairs = view.expected("attempts"), view.frame("attempts"), view.aligned("attempts")
    stands = np.isin(expected["disposition"][pairs.expected], _STANDS) | np.isin(
        found["disposition"][pairs.found], _STANDS
    )
    yield from columns_agree(view, "attempts", ("disposition",), where=~stands)


@rule("BD-CAN-011")
def records_and_dispositions_agree(view: ReleaseView) -> Iterator[Check]:
    """Exactly the attempts that records name are selected or kept."""
    records, attempts = view.frame("records"), view.frame("attempts")
    disposition_of = dict(zip(("selected", "ineligible"), _STANDS, strict=True))
    named = {
        rollout_id: disposition_of[state]
        for rollout_id, state in zip(records["rollout_id"].tolist(), records["state"].tolist(), strict=True)
        if rollout_id is not None and state in disposition_of
    }
    listed = dict(zip(attempts["rollout_id"].tolist(), attempts["disposition"].tolist(), strict=True))
    taken = {rollout_id for rollout_id, word in listed.items() if word in _STANDS}
    bad = sorted(r for r in named.keys() | taken if named.get(r) != listed.get(r))
    yield Check.of(
        len(listed),
        [
            Mismatch(
                {**place_in_table(view, "attempts"), "column": "disposition", "rollout_id": r},
                named.get(r, "neither selected nor kept"),
                listed.get(r, "not listed"),
            )
            for r in bad
        ],
    )


def _counts(view: ReleaseView) -> tuple[dict[str, Any], list[str]]:
    """Counts of rows, and the groups that have any."""
    records, attempts = view.frame("records"), view.frame("attempts")
    groups = {*records["group_id"].tolist(), *attempts["group_id"].tolist()}
    return source_counts(records, attempts), sorted(groups)


def _sum_of_counts(pieces: Sequence[tuple[dict[str, Any], list[str]]]) -> dict[str, Any]:
    distinct([groups for _, groups in pieces])
    return sum_of_counts([counts for counts, _ in pieces])


@rule("BD-CAN-012", _counts)
def canonical_counts_add_up(view: ReleaseView) -> Iterator[Check]:
    """Numbers of groups, attempts, records and dispositions are those of the tables."""
    document = view.document(SOURCE_FILE)
    counts = view.merged(_counts, _sum_of_counts)
    found = {name: document[name] for name in counts}
    yield document_check(SOURCE_FILE, len(counts), document_mismatches(counts, found))
