"""Findings say in words what was expected and what was found, with the values of the place."""

from __future__ import annotations

import pytest
from tests.mutation import MUTANTS
from tests.sampling import sampled
from tests.validator.engine.rules.case import report_on

SPLIT_DIGEST = "728b7774e60b13d2ee76983dd03595e50dca6e7b689be09a32df290424830a17"
"""Digest of the split of the synthetic release."""

BY_NAME = {(mutant.rule, mutant.name): mutant for mutant in MUTANTS}


@pytest.mark.parametrize(
    ("rule", "name", "expected", "found"),
    sampled([
        ("BD-LAY-003", "table_removed", "a file that the manifest lists", "no such file"),
        ("BD-LAY-006", "link_in_place_of_a_table", "a regular file or folder", "a symbolic link"),
        ("BD-LAY-006", "pipe_in_place_of_a_table", "a regular file or folder", "a special file"),
        ("BD-LAY-007", "path_too_long", "a path within the limits", "is longer than 240 bytes"),
        (
            "BD-LAY-009", "companion_that_the_manifest_lists",
            "a place in the layout", "none, though the manifest lists it",
        ),
        ("BD-DOC-002", "version_of_the_future", "'0.1'", "'0.2'"),
        ("BD-TAB-003", "another_unit", "unit 'm'", "'cm'"),
        ("BD-VAL-002", "throttle_in_percent", "0 .. 1", "30.0"),
        ("BD-VAL-002", "yaw_in_degrees", "-3.14159 .. 3.14159 rad", "90.0, as what is in degrees"),
        ("BD-VAL-003", "unknown_source", "one of ['online_expert', 'intervention']", "'autopilot'"),
        (
            "BD-VAL-005", "route_with_fewer_x_than_y",
            "2 .. 10000 vertices, no two neighbours equal", "80 x and 81 y values",
        ),
        ("BD-NUL-002", "value_missing_under_its_mask", "a value (`separation_available` is on)", "null"),
        ("BD-NUL-002", "zero_stands_for_absence", "null (`nearest_pedestrian_available` is off)", "0.0"),
        (
            "BD-NUL-004", "reason_of_a_complete_attempt",
            "null (`status` is 'complete')", "'went well'",
        ),
        ("BD-KEY-003", "group_repeated_in_another_shard", "one shard", "raw/shard-00000, raw/shard-00001"),
        ("BD-KEY-006", "evidence_twice", "one row per key and observation", "a second row"),
        ("BD-KEY-006", "evidence_between_observations", "one row per key and observation", "no observation"),
        ("BD-KEY-007", "control_row_lost", "200, the number of rows, the last at tick 199", "201"),
        ("BD-KEY-008", "replay_of_an_intervention", "'nominal'", "'brake_0.30'"),
        ("BD-KEY-008", "intervention_under_the_nominal_key", "an intervening policy of the bank", "'nominal'"),
        ("BD-STA-001", "retry_that_ended_early", "status complete", "'partial': 'the ego was stuck'"),
        ("BD-TIC-001", "tick_missing", "tick 10 after tick 9", "tick 11"),
        ("BD-TIC-001", "ticks_from_one", "tick 0 first", "tick 1"),
        ("BD-TIC-002", "observation_missing", "tick 5 after tick 0", "tick 10"),
        (
            "BD-TIC-003", "frames_counted_from_one",
            "branch_tick = 5 x branch_frame", "branch_tick 100 and branch_frame 21",
        ),
        ("BD-TIC-003", "group_without_a_branch", "a branch tick", "no branch: the trigger found nothing"),
        ("BD-CTL-001", "active_one_tick_too_early", "inactive before branch tick 100", "active"),
        ("BD-CTL-002", "window_shorter_by_a_tick", "50 active ticks, 100 .. 149", "49 active ticks, 100 .. 148"),
        ("BD-CTL-002", "window_later_by_a_tick", "50 active ticks, 100 .. 149", "50 active ticks, 101 .. 150"),
        ("BD-CTL-002", "intervention_that_never_began", "50 active ticks, 100 .. 149", "0 active ticks"),
        ("BD-CTL-007", "brake_below_its_floor", "brake 0.5 (`floor`)", "intended_brake 0.25"),
        ("BD-CTL-011", "expert_named_while_active", "`intervention`", "`online_expert`"),
        ("BD-CTL-012", "recording_ends_with_the_policy", "the online expert drives", "no control row"),
        (
            "BD-CTL-012", "recovery_that_cannot_be_recorded",
            "the online expert drives", "a policy with the recovery 'hold'",
        ),
        ("BD-CTL-014", "accelerates_with_online_steering", "'zero'", "'online_expert'"),
        ("BD-CTL-014", "meant_to_last_longer", "50", "51"),
        ("BD-WIN-001", "branch_within_the_first_80_ticks", "80 controls before tick 75", "75"),
        ("BD-WIN-002", "branch_without_a_predecessor", "17 rows, -5 .. 75", "1 missing"),
        ("BD-WIN-003", "no_control_at_the_end_of_the_window", "51 controls from tick 100", "1 missing"),
        ("BD-WIN-003", "no_observation_at_the_end_of_the_window", "10 rows, 105 .. 150", "1 missing"),
        ("BD-WIN-004", "no_evidence_at_all", "26 rows, 25 .. 150", "26 missing"),
        ("BD-WIN-005", "far_actor_lost", "7 actor rows", "6"),
        ("BD-EVD-001", "separation_of_another_actor", "actor 1", "actor 7"),
        ("BD-EVD-002", "ttc_where_nobody_is", "unavailable", "499.0"),
        ("BD-TRG-001", "trigger_read_from_the_intervention", "'g0.nominal.a1'", "'g0.brake_0.50.a1'"),
        (
            "BD-TRG-002", "trigger_before_the_branch",
            "a trigger tick of the nominal at or after branch tick 100", "tick 99",
        ),
        (
            "BD-TRG-002", "trigger_after_the_nominal_ended",
            "a trigger tick of the nominal at or after branch tick 100", "tick 201, which the nominal does not have",
        ),
        ("BD-BNK-001", "action_never_executed", "all 13 policies", "no complete attempt of brake_0.50"),
        (
            "BD-BNK-002", "one_action_against_another_nominal",
            "nominal 'g0.nominal.a1' throughout", "another nominal under brake_0.50",
        ),
        (
            "BD-GRP-003", "another_seed_beyond_double_precision",
            "9007199254740992 as in the nominal", "9007199254740993",
        ),
        ("BD-GRP-004", "one_action_branched_a_frame_later", "100 as in the nominal", "105"),
        ("BD-LYR-003", "privileged_column_among_sensor_histories", "no undeclared column", "double"),
        ("BD-LYR-006", "group_listed_in_two_partitions", "a unique key", "the key of another row"),
        ("BD-LYR-009", "contexts_in_reverse", "rows in the order of their key", "14 rows out of order"),
        ("BD-CAN-002", "copy_chosen_in_place_of_the_first", "'g2.brake_0.50.a1'", "'g2.brake_0.50.a2'"),
        ("BD-CAN-008", "attempt_left_unexplained", "a row with this key", "no such row"),
        ("BD-CAN-008", "attempt_that_raw_does_not_have", "at most one row with this key", "an unexpected row"),
        ("BD-CAN-011", "two_attempts_selected", "neither selected nor kept", "selected"),
        ("BD-QUA-006", "incomplete_bank_called_complete", "False", "True"),
        ("BD-QUA-007", "group_with_another_reason", "'BD-BNK-001'", "'BD-BNK-002'"),
        (
            "BD-QUA-010", "group_neither_eligible_nor_lost",
            "stages in order, lost exactly where not eligible", "no stage; not lost",
        ),
        ("BD-SPL-002", "twin_called_a_cluster_of_its_own", "route cluster 13", "route cluster 99"),
        (
            "BD-SPL-003", "cluster_in_two_partitions",
            "one partition for all groups of route cluster 13", "train (g4), val (g5)",
        ),
        ("BD-SPL-007", "near_duplicate_let_through", "a near duplicate", "no near duplicate"),
        ("BD-FID-006", "thresholds_of_another_split", SPLIT_DIGEST, "0" * 64),
        (
            "BD-FID-012", "test_accessed_under_other_thresholds_before",
            "one test-set access", "2 accesses",
        ),
    ], every=2),
)  # fmt: skip
def test_words_of_a_finding(rule: str, name: str, expected: str, found: str) -> None:
    findings = report_on(BY_NAME[rule, name]).findings
    words = [(finding.expected, finding.found) for finding in findings if finding.rule == rule]
    assert (expected, found) in words


def test_a_finding_is_one_sentence_with_its_place() -> None:
    (finding,) = report_on(BY_NAME["BD-CTL-008", "applied_beyond_the_tolerance"]).findings
    start = (
        "Does not hold: Applied control equals intended control while active: group_id=g0 "
        "rollout_id=g0.steer_left_0.10.a1 table=controls tick=110: expected steer -0.1"
    )
    assert finding.message.startswith(start)
    assert "found steer -0.084" in finding.message
