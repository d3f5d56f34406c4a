"""Key rules: identities, references and counts of a shard. Source: spec/03-layout.md#keys."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from branchdrive.audit.check import RowCheck, SurveyCheck, shard_rule, survey_rule
from branchdrive.audit.finding import Sighting, quote
from branchdrive.audit.survey import Survey
from branchdrive.audit.view import ShardView

ATTEMPT_KEY = ("group_id", "role", "action_key", "protocol_variant", "attempt")


@survey_rule("BD-KEY-001")
def rollout_ids_are_unique(survey: Survey) -> SurveyCheck:
    """No rollout identity twice in the dataset."""
    count = Counter(rollout_id for shard in survey.shards for rollout_id in shard.rollout_ids)
    return SurveyCheck(
        sum(count.values()),
        tuple(
            Sighting("a unique rollout_id", f"{n} rows", {"table": "rollouts", "rollout_id": rollout_id})
            for rollout_id, n in count.items()
            if n > 1
        ),
    )


@survey_rule("BD-KEY-003")
def groups_stay_in_one_shard(survey: Survey) -> SurveyCheck:
    """No branch group in two shards."""
    homes: dict[str, list[str]] = {}
    for shard in survey.shards:
        for group_id in shard.group_ids:
            homes.setdefault(group_id, []).append(shard.folder)
    return SurveyCheck(
        len(homes),
        tuple(
            Sighting("one shard", ", ".join(folders[:4]), {"group_id": group_id})
            for group_id, folders in homes.items()
            if len(folders) > 1
        ),
    )


@shard_rule("BD-KEY-002")
def attempt_keys_are_unique(view: ShardView) -> Iterator[RowCheck]:
    """No two attempts with the same group, role, action key, protocol variant and number."""
    keys = list(zip(*(view.rollouts[column] for column in ATTEMPT_KEY), strict=True))
    count = Counter(keys)
    bad = np.flatnonzero([count[key] > 1 for key in keys])
    yield RowCheck(
        "rollouts",
        "attempt",
        len(keys),
        bad,
        lambda row: ("a unique attempt key", quote(tuple(map(str, keys[row])))),
    )


@shard_rule("BD-KEY-004")
def rows_belong_to_rollouts(view: ShardView) -> Iterator[RowCheck]:
    """Every stream row names an attempt of its shard."""
    for name in view.table_names[1:]:
        stream = view.stream(name)
        bad = np.flatnonzero(stream.rollout < 0)
        yield RowCheck(
            name, "rollout_id", len(stream), bad,
            lambda row, s=stream: ("a rollout_id of the shard's rollouts table", quote(s["rollout_id"][row])),  # type: ignore[misc]
        )  # fmt: skip


@shard_rule("BD-KEY-005")
def nominal_references_resolve(view: ShardView) -> Iterator[RowCheck]:
    """The named nominal is an attempt of the same group with the role nominal."""
    named = view.rollouts.valid("nominal_rollout_id")
    nominal = view.nominal
    at = np.maximum(nominal, 0)
    sound = (nominal >= 0) & view.role("nominal")[at] & (view.group[at] == view.group)
    bad = np.flatnonzero(named & ~view.role("nominal") & ~sound)
    yield RowCheck(
        "rollouts", "nominal_rollout_id", view.num_rollouts, bad,
        lambda row: ("a nominal rollout of the same group", quote(view.rollouts["nominal_rollout_id"][row])),
    )  # fmt: skip


@shard_rule("BD-KEY-006")
def evidence_belongs_to_observations(view: ShardView) -> Iterator[RowCheck]:
    """Evidence and actor rows are unique under their key and sit on a saved observation."""
    observations = view.observations
    for name in ("evidence", "actors"):
        if name not in view:
            continue
        stream = view.stream(name)
        known = stream.rollout >= 0
        orphan = known & (observations.rows_of(stream) < 0)
        repeated = (stream.repeats if name == "evidence" else stream.repeats_with(stream["actor_id"])) & known
        yield RowCheck(
            name, None, len(stream), np.flatnonzero(orphan | repeated),
            lambda row, o=orphan: ("one row per key and observation", "no observation" if o[row] else "a second row"),  # type: ignore[misc]
        )  # fmt: skip


@shard_rule("BD-KEY-007")
def row_counts_match(view: ShardView) -> Iterator[RowCheck]:
    """``num_ticks`` and ``num_observations`` are the rows that the streams hold."""
    for column, name in (("num_ticks", "controls"), ("num_observations", "observations")):
        stream = view.stream(name)
        rows = stream.stop - stream.start
        recorded = view.rollouts[column]
        yield RowCheck(
            "rollouts", column, view.num_rollouts, np.flatnonzero(rows != recorded),
            lambda row, r=rows, c=recorded: (f"the {r[row]} rows that are there", quote(c[row])),  # type: ignore[misc]
        )  # fmt: skip


@shard_rule("BD-KEY-008")
def action_keys_agree_with_roles(view: ShardView) -> Iterator[RowCheck]:
    """Interventions execute a policy of the bank that intervenes; the other roles the nominal policy."""
    bank = view.descriptor.action_bank
    nominal = list(bank.keys).index(bank.nominal.key)
    intervenes = view.role("intervention")
    known = view.policy >= 0
    bad = np.flatnonzero(~known | ((view.policy == nominal) == intervenes))
    yield RowCheck(
        "rollouts", "action_key", view.num_rollouts, bad,
        lambda row: (
            "an intervening policy of the bank" if intervenes[row] else f"{bank.nominal.key!r}",
            quote(view.rollouts["action_key"][row]),
        ),
    )  # fmt: skip
