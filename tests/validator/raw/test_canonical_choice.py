"""Canonical choice: the nominal first, then one attempt per action; outcomes and order are never read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests import synthetic
from tests.mutation import new_draft
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, NOMINAL

from branchdrive.contract.columns import table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.validate import validate
from branchdrive.raw.canonical_choice import select_candidates
from branchdrive.raw.shard_view import ShardView

DESCRIPTOR = Descriptor.model_validate(synthetic.descriptor())
KEYS = DESCRIPTOR.action_bank.keys
RETRY = "g0.brake_0.50.a2"
OTHER_NOMINAL = "g0.nominal.a2"


def records(**more: dict[str, Any]) -> list[dict[str, Any]]:
    """Attempts of a whole group, with further ones that differ from their original in some columns."""
    rows: list[dict[str, Any]] = synthetic.make_group(0)["rollouts"].to_pylist()
    by_id = {row["rollout_id"]: row for row in rows}
    further = [{**by_id[changes["of"]], "rollout_id": name, **changes} for name, changes in more.items()]
    return rows + [{column: value for column, value in row.items() if column != "of"} for row in further]


def chosen(rows: Sequence[dict[str, Any]], non_compliant: Sequence[str] = ()) -> dict[str, str | None]:
    """Chosen attempt by action key, ``None`` where the group has none."""
    view = ShardView({"rollouts": pa.Table.from_pylist(list(rows), schema=table_schema("rollouts"))}, DESCRIPTOR)
    compliant = np.array([row["rollout_id"] not in non_compliant for row in rows])
    selection = select_candidates(view, compliant)
    assert selection.chosen.shape == (1, len(KEYS))
    assert selection.nominal[0] == selection.chosen[0, KEYS.index("nominal")]
    return {key: rows[i]["rollout_id"] if i >= 0 else None for key, i in zip(KEYS, selection.chosen[0], strict=True)}


def retry(**changes: Any) -> dict[str, dict[str, Any]]:
    return {RETRY: {"of": BRAKE, "attempt": 2, **changes}}


def second_nominal(**changes: Any) -> dict[str, dict[str, Any]]:
    return {OTHER_NOMINAL: {"of": NOMINAL, "attempt": 2, "trigger_rollout_id": OTHER_NOMINAL, **changes}}


def test_whole_group_is_chosen() -> None:
    assert chosen(records()) == {key: f"g0.{key}.a1" for key in KEYS}


def test_lower_number_is_chosen_among_compliant_attempts() -> None:
    assert chosen(records(**retry()))["brake_0.50"] == BRAKE


def test_compliant_retry_is_chosen_over_a_lower_number() -> None:
    assert chosen(records(**retry()), [BRAKE])["brake_0.50"] == RETRY


def test_lowest_number_stays_where_nothing_complies() -> None:
    assert chosen(records(**retry()), [BRAKE, RETRY])["brake_0.50"] == BRAKE


def test_retry_is_chosen_over_an_attempt_that_is_not_complete() -> None:
    rows = [
        {**row, "status": "partial", "status_reason": "stuck"} if row["rollout_id"] == BRAKE else row
        for row in records(**retry())
    ]
    assert chosen(rows, [BRAKE])["brake_0.50"] == RETRY
    assert chosen(rows, [BRAKE, RETRY])["brake_0.50"] == RETRY


def test_action_without_a_complete_attempt_is_missing() -> None:
    rows = [row for row in records() if row["rollout_id"] != BRAKE]
    assert chosen(rows) == {key: None if key == "brake_0.50" else f"g0.{key}.a1" for key in KEYS}


def test_equal_numbers_are_ordered_by_identity() -> None:
    same = {name: {"of": BRAKE, "attempt": 2} for name in ("g0.brake_0.50.b", "g0.brake_0.50.a")}
    assert chosen(records(**same), [BRAKE])["brake_0.50"] == "g0.brake_0.50.a"


def test_numbers_are_compared_within_a_variant() -> None:
    variants = {
        "g0.brake_0.50.b": {"of": BRAKE, "protocol_variant": "v2"},
        "g0.brake_0.50.a": {"of": BRAKE, "protocol_variant": "v3"},
    }
    assert chosen(records(**variants))["brake_0.50"] == BRAKE
    assert chosen(records(**variants), [BRAKE])["brake_0.50"] == BRAKE


def test_a_further_nominal_under_its_own_variant_loses_nothing() -> None:
    for variant in ("a", "v1", "z"):  # names before, equal to and after that of the group
        assert chosen(records(**second_nominal(attempt=2, protocol_variant=variant))) == {
            key: f"g0.{key}.a1" for key in KEYS
        }
    further = second_nominal(attempt=1, protocol_variant="a")
    assert chosen(records(**further), [BRAKE])["nominal"] == NOMINAL


def test_a_group_takes_the_variant_in_which_most_attempts_comply() -> None:
    own = {"protocol_variant": "z", "nominal_rollout_id": "z.nominal", "attempt": 3}
    whole = {f"z.{key}": {"of": f"g0.{key}.a1", **own} for key in KEYS if key != "nominal"}
    whole["z.nominal"] = {"of": NOMINAL, "attempt": 3, "protocol_variant": "z"}
    assert chosen(records(**whole))["brake_0.50"] == BRAKE
    assert chosen(records(**whole), [BRAKE]) == {key: f"z.{key}" for key in KEYS}
    assert chosen(records(**whole), [BRAKE, "z.nominal", "z.brake_0.50"])["nominal"] == NOMINAL


def test_an_action_that_only_another_variant_has_is_taken_from_there() -> None:
    rows = [{**row, "protocol_variant": "v2"} if row["rollout_id"] == BRAKE else row for row in records()]
    assert chosen(rows) == {key: f"g0.{key}.a1" for key in KEYS}


def test_numbers_are_compared_as_numbers() -> None:
    later = {f"g0.brake_0.50.a{number}": {"of": BRAKE, "attempt": number} for number in (10, 9)}
    assert chosen(records(**later), [BRAKE])["brake_0.50"] == "g0.brake_0.50.a9"


def test_compliant_nominal_is_chosen_first() -> None:
    assert chosen(records(**second_nominal()))["nominal"] == NOMINAL
    assert chosen(records(**second_nominal()), [NOMINAL])["nominal"] == OTHER_NOMINAL


def test_attempt_against_another_nominal_does_not_comply() -> None:
    against_other = retry(attempt=1, nominal_rollout_id=OTHER_NOMINAL)
    rows = records(**second_nominal(), **against_other)
    rows = [{**row, "attempt": 2} if row["rollout_id"] == BRAKE else row for row in rows]
    assert chosen(rows)["brake_0.50"] == BRAKE
    assert chosen(rows, [NOMINAL])["brake_0.50"] == RETRY


def test_attempt_against_another_nominal_is_kept_where_it_is_the_only_one() -> None:
    rows = [
        {**row, "nominal_rollout_id": OTHER_NOMINAL} if row["rollout_id"] == BRAKE else row
        for row in records(**second_nominal())
    ]
    assert chosen(rows)["brake_0.50"] == BRAKE


def test_replay_never_stands_in_for_the_nominal() -> None:
    rows = [
        {**row, "status": "partial", "status_reason": "stuck"} if row["rollout_id"] == NOMINAL else row
        for row in records()
    ]
    picked = chosen(rows)
    assert picked["nominal"] is None
    assert picked["brake_0.50"] == BRAKE


def test_choice_reads_no_outcome() -> None:
    bad = {"result_completion": "aborted", "result_num_vehicle_collisions": 9, "result_route_fraction": 0.0}
    good = {"result_completion": "completed", "result_num_vehicle_collisions": 0, "result_route_fraction": 1.0}
    for first, second in ((bad, good), (good, bad)):
        rows = [{**row, **first} if row["rollout_id"] == BRAKE else row for row in records(**retry(**second))]
        assert chosen(rows)["brake_0.50"] == BRAKE


@pytest.mark.parametrize("seed", [11, 23, 37])
def test_choice_does_not_depend_on_the_order_of_rows(seed: int) -> None:
    rows = records(**second_nominal(), **retry())
    shuffled = [rows[i] for i in np.random.default_rng(seed).permutation(len(rows))]
    for non_compliant in ([], [BRAKE], [NOMINAL], [NOMINAL, BRAKE]):
        assert chosen(shuffled, non_compliant) == chosen(rows, non_compliant)


def test_groups_are_chosen_apart() -> None:
    rows = records() + [
        row for row in synthetic.make_group(1)["rollouts"].to_pylist() if "brake_0.30" not in row["action_key"]
    ]
    view = ShardView({"rollouts": pa.Table.from_pylist(rows, schema=table_schema("rollouts"))}, DESCRIPTOR)
    selection = select_candidates(view, np.ones(len(rows), bool))
    assert (selection.chosen < 0).sum(axis=1).tolist() == [0, 1]
    assert [view.group_ids[view.group[i]] for i in selection.chosen[:, 1]] == ["g0", "g1"]


# The same through files: what the choice means for the group.


def test_compliant_retry_saves_its_group(tmp_path: Path) -> None:
    draft = new_draft()
    draft.copy_attempt(BRAKE, RETRY, attempt=2)
    draft.set("controls", "applied_brake", 0.25, rollout_id=BRAKE, tick=BRANCH_TICK)
    report = validate(draft.write(tmp_path / "dataset"))
    assert [(f.rule, f.location["rollout_id"]) for f in report.findings] == [("BD-CTL-008", BRAKE)]
    assert report.funnel is not None
    assert report.funnel.qualified == 3


def test_group_of_a_worse_nominal_is_lost_with_it(tmp_path: Path) -> None:
    """The second nominal complies, is chosen, and nothing was executed against it."""
    draft = new_draft()
    draft.copy_attempt(NOMINAL, OTHER_NOMINAL, attempt=2, trigger_rollout_id=OTHER_NOMINAL)
    draft.set("controls", "applied_steer", 0.5, rollout_id=NOMINAL, tick=50)
    report = validate(draft.write(tmp_path / "dataset"))
    found = [(f.rule, f.location.get("rollout_id"), f.location.get("group_id"), f.count) for f in report.findings]
    assert found == [("BD-CTL-009", NOMINAL, "g0", 1), ("BD-BNK-002", None, "g0", 12)]
    assert report.funnel is not None
    assert report.funnel.reasons["bank"] == {"BD-BNK-002": 1}


def test_group_without_a_complete_nominal_is_lost_at_the_bank(tmp_path: Path) -> None:
    draft = new_draft()
    draft.set("rollouts", "status", "quarantined", rollout_id=NOMINAL)
    draft.set("rollouts", "status_reason", "the server lagged", rollout_id=NOMINAL)
    report = validate(draft.write(tmp_path / "dataset"))
    assert {f.rule for f in report.findings} == {"BD-STA-001", "BD-BNK-001"}
    assert report.funnel is not None
    assert report.funnel.reasons["bank"] == {"BD-BNK-001": 1}
    unexamined = [t.rule_id for t in report.tallies if t.info.grain == "group" and t.examined == 2 and t.total == 3]
    shared = [f"BD-GRP-{number:03}" for number in (1, 2, 3, 4, 5, 7, 8, 9, 10, 11)]
    assert unexamined == ["BD-BNK-002", *shared]
