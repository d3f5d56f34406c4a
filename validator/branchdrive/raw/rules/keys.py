"""Key rules: identities, references and counts of a shard. Source: spec/03-layout.md#keys."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Check, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.files.shard_facts import num_groups, repeated_rollouts, scattered_groups
from branchdrive.files.survey import Survey
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.content import sortable
from branchdrive.tables.view import StreamView, TableView

ATTEMPT_KEY = ("group_id", "role", "action_key", "protocol_variant", "attempt")


@rule("BD-KEY-001")
def rollout_ids_are_unique(survey: Survey) -> Iterator[Check]:
    """No rollout identity twice in the dataset."""
    yield Check.of(
        sum(len(shard.rollout_ids) for shard in survey.shards),
        tuple(
            Mismatch({"table": "rollouts", "rollout_id": rollout_id}, "a unique rollout_id", f"{n} rows")
            for rollout_id, n in repeated_rollouts(survey.shards).items()
        ),
    )


@rule("BD-KEY-003")
def groups_stay_in_one_shard(survey: Survey) -> Iterator[Check]:
    """No branch group in two shards."""
    yield Check.of(
        num_groups(survey.shards),
        tuple(
            Mismatch({"group_id": group_id}, "one shard", ", ".join(folders[:4]))
            for group_id, folders in scattered_groups(survey.shards).items()
        ),
    )


@rule("BD-KEY-002")
def attempt_keys_are_unique(view: ShardView) -> Iterator[Check]:
    """No two attempts with the same group, role, action key, protocol variant and number."""
    keys = list(zip(*(view.rollouts[column] for column in ATTEMPT_KEY), strict=True))
    count = Counter(keys)
    bad = np.flatnonzero([count[key] > 1 for key in keys])
    yield Check.of_rows(
        "rollouts", "attempt", len(keys), bad, lambda row: ("a unique attempt key", quote(tuple(map(str, keys[row]))))
    )


@rule("BD-TAB-007")
def rows_are_in_the_order_of_their_keys(view: ShardView) -> Iterator[Check]:
    """No row has a key below that of the row before it; texts by their bytes, numbers by value."""
    for name in view.table_names:
        table, key = view[name], TABLES[name].key
        below = np.zeros(0, np.intp) if _is_stored_as_seen(view, table) else _below(table)
        expected = f"a key ({', '.join(key)}) above that of the row before"
        yield Check.of_rows(name, key[-1], len(table), below, lambda _, text=expected: (text, "one below it"))  # type: ignore[misc]


def _below(table: TableView) -> NDArray[np.intp]:
    """Rows whose key is below that of the row stored before."""
    stored = np.argsort(table.position) if isinstance(table, StreamView) else np.arange(len(table))
    is_below = np.zeros(max(len(stored) - 1, 0), bool)
    for values in (sortable(table, column)[stored] for column in TABLES[table.name].key[::-1]):
        is_below = np.where(values[1:] == values[:-1], is_below, values[1:] < values[:-1])
    return np.sort(stored[1:][is_below])


def _is_stored_as_seen(view: ShardView, table: TableView) -> bool:
    """Whether a stream surely is in the order of its keys: stored as it is seen, of attempts in the order of theirs."""
    if not isinstance(table, StreamView) or table.num_unknown or not table.is_as_stored:
        return False
    if any(after < before for before, after in pairwise(view.rollout_ids)):
        return False
    further = [sortable(table, column) for column in TABLES[table.name].key[2:]]
    return table.ascends or not any((table.repeats[1:] & (part[1:] < part[:-1])).any() for part in further)


def _unknown_rollout(stream: TableView, row: int) -> tuple[str, str]:
    return "a rollout_id of the shard's rollouts table", quote(stream["rollout_id"][row])


@rule("BD-KEY-004")
def rows_belong_to_rollouts(view: ShardView) -> Iterator[Check]:
    """Every stream row names an attempt of its shard."""
    for name in view.table_names[1:]:
        if not TABLES[name].is_of_rollouts:
            continue
        stream = view.stream(name)
        bad = np.flatnonzero(stream.valid("rollout_id")[: stream.num_unknown])
        yield Check.of_rows(
            name,
            "rollout_id",
            len(stream),
            bad,
            partial(_unknown_rollout, stream),
        )


@rule("BD-KEY-005")
def nominal_references_resolve(view: ShardView) -> Iterator[Check]:
    """The named nominal is an attempt of the same group with the role nominal."""
    named = view.rollouts.valid("nominal_rollout_id") & ~view.role("nominal")
    nominal = view.nominal
    at = np.maximum(nominal, 0)
    sound = (nominal >= 0) & view.role("nominal")[at] & (view.group[at] == view.group)
    bad = np.flatnonzero(named & ~sound)
    yield Check.of_rows(
        "rollouts",
        "nominal_rollout_id",
        int(named.sum()),
        bad,
        lambda row: ("a nominal rollout of the same group", quote(view.rollouts["nominal_rollout_id"][row])),
    )


def _misplaced(orphan: Mask, row: int) -> tuple[str, str]:
    return "one row per key and observation", "no observation" if orphan[row] else "a second row"


@rule("BD-KEY-006")
def evidence_belongs_to_observations(view: ShardView) -> Iterator[Check]:
    """Evidence and actor rows are unique under their key and sit on a saved observation."""
    observations = view.observations
    for name in ("evidence", "actors"):
        if name not in view:
            continue
        stream = view.stream(name)
        is_lost = observations.rows_of_moments(stream) < 0
        if stream.ascends and not is_lost.any():
            yield Check.of_rows(name, None, len(stream), np.zeros(0, np.intp), partial(_misplaced, is_lost))
            continue
        orphan = stream.of_moments(is_lost)
        repeated = stream.repeats if name == "evidence" else stream.repeats_with(stream["actor_id"])
        if num_unknown := stream.num_unknown:  # they come first
            repeated = repeated.copy()
            orphan[:num_unknown] = repeated[:num_unknown] = False
        yield Check.of_rows(
            name,
            None,
            len(stream),
            np.flatnonzero(orphan | repeated),
            partial(_misplaced, orphan),
        )


def _miscounted(stream: StreamView, recorded: NDArray[np.int64], row: int) -> tuple[str, str]:
    num_rows, stop = int(stream.stop[row] - stream.start[row]), int(stream.stop[row])
    last = f", the last at tick {stream['tick'][stop - 1]}" if num_rows and stream.valid("tick")[stop - 1] else ""
    return f"{num_rows}, the number of rows{last}", quote(recorded[row])


@rule("BD-KEY-007")
def row_counts_match(view: ShardView) -> Iterator[Check]:
    """``num_ticks`` and ``num_observations`` are the rows that the streams hold."""
    for column, name in (("num_ticks", "controls"), ("num_observations", "observations")):
        stream = view.stream(name)
        recorded = view.rollouts[column]
        bad = np.flatnonzero(stream.stop - stream.start != recorded)
        yield Check.of_rows("rollouts", column, view.num_rollouts, bad, partial(_miscounted, stream, recorded))


@rule("BD-KEY-008")
def action_keys_agree_with_roles(view: ShardView) -> Iterator[Check]:
    """Interventions execute a policy of the bank that intervenes, nominals and replays the nominal policy.

    Drives, which only a dataset with decisions has, begin with any.
    """
    bank = view.descriptor.action_bank
    nominal = list(bank.keys).index(bank.nominal.key)
    intervenes, drives = view.role("intervention"), view.role("drive")
    is_known = view.policy >= 0
    is_fit = np.where(drives, view.descriptor.is_of_drives, (view.policy == nominal) != intervenes)
    bad = np.flatnonzero(~(is_known & is_fit))

    def expected(row: int) -> str:
        if drives[row]:
            return "a policy of the bank" if view.descriptor.is_of_drives else "no drive, as no decisions are claimed"
        return "an intervening policy of the bank" if intervenes[row] else f"{bank.nominal.key!r}"

    yield Check.of_rows(
        "rollouts",
        "action_key",
        view.num_rollouts,
        bad,
        lambda row: (expected(row), quote(view.rollouts["action_key"][row])),
    )
