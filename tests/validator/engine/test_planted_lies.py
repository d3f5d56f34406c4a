"""Forty lies that a release could tell: each is found by the rule that is there for it, and makes it invalid."""

from __future__ import annotations

from tests.each import each
from tests.mutation import MUTANTS

from branchdrive.contract.rule import CATALOGUE

LIES = {
    "an attempt of the raw layer is not mentioned": "BD-CAN-008 attempt_left_unexplained",
    "a better retry stands for an action": "BD-CAN-002 better_retry_chosen",
    "an attempt that broke a rule is called selected": "BD-CAN-003 noncompliant_attempt_selected",
    "an attempt that broke a rule is called superseded": "BD-CAN-010 noncompliant_attempt_called_superseded",
    "a magnitude is that of another action": "BD-CAN-007 magnitude_of_another_action",
    "an attempt that broke a rule is called compliant": "BD-QUA-002 noncompliant_attempt_called_compliant",
    "a group with two seeds is called eligible": "BD-QUA-006 group_with_two_seeds_called_eligible",
    "the population is larger by one group": "BD-QUA-011 frozen_population_of_one_more",
    "a variant is counted into the frozen population": "BD-QUA-012 variant_counted_into_the_frozen_population",
    "a route cluster lies in two partitions": "BD-SPL-003 cluster_in_two_partitions",
    "a group moves to another partition behind the digest": "BD-SPL-004 group_moved_behind_the_digest",
    "a near duplicate of a training group is not marked": "BD-SPL-007 near_duplicate_let_through",
    "the noise of a replay is understated": "BD-FID-003 noise_of_a_replay_understated",
    "thresholds are fitted on all partitions": "BD-FID-005 thresholds_of_all_partitions",
    "a threshold is loosened by hand": "BD-FID-005 threshold_loosened_by_hand",
    "failing pairs are waved through": "BD-FID-007 failing_pairs_waved_through",
    "a noisy group is called valid": "BD-FID-008 noisy_group_called_valid",
    "retention is rounded up": "BD-FID-009 retention_rounded_up",
    "the access of the test partition is not recorded": "BD-FID-010 ledger_without_the_access_of_test",
    "a test group is left out of the model layer": "BD-MOD-001 group_of_the_test_partition_left_out",
    "a group that fails replay is taken into the model layer": "BD-MOD-001 group_that_fails_replay_taken_in",
    "a history has a row of the future": "BD-LYR-007 state_of_the_future",
    "a history is shifted by one tick into the future": "BD-MOD-006 controls_of_a_tick_later",
    "the last control before the branch already brakes": "BD-MOD-006 brake_before_the_branch",
    "the expert knew of a hazard before it was there": "BD-MOD-007 hazard_of_the_future",
    "the encodings of two actions are exchanged": "BD-MOD-009 encodings_permuted",
    "two candidates are exchanged": "BD-MOD-010 candidates_swapped",
    "a target is off by a thousandth": "BD-MOD-012 separation_off_by_a_thousandth",
    "one bit of a mask is off": "BD-MOD-013 mask_off",
    "the candidates are presented in another order": "BD-MOD-017 candidate_order_changed",
    "a privileged feature is called a sensor's": "BD-MOD-017 privileged_feature_called_sensor",
    "the normalisation saw validation groups": "BD-MOD-018 normalisation_of_training_and_validation",
    "a test context repeats a training context": "BD-MOD-020 context_that_repeats_a_training_context",
    "the leakage audit was made of other groups": "BD-LKG-001 audit_of_fewer_groups",
    "a gate that failed is called passed": "BD-LKG-004 failed_gate_called_passed",
    "an inconclusive gate is called passed": "BD-LKG-004 inconclusive_gate_called_passed",
    "p-values are not adjusted for their number": "BD-LKG-004 p_values_not_adjusted",
    "a target is hidden in the history": "BD-LKG-010 target_hidden_in_the_history",
    "the raw layer is another": "BD-REL-001 digest_of_another_raw_layer",
    "the card has a better number": "BD-REL-003 card_with_a_better_number",
}
"""The lie, and the rule with the registered defect that tells it."""


def test_there_are_forty_in_every_area_of_a_release() -> None:
    assert len(LIES) == len(set(LIES.values())) == 40
    areas = {defect[3:6] for defect in LIES.values()}
    assert areas == {"LYR", "CAN", "QUA", "SPL", "FID", "MOD", "LKG", "REL"}


@each("lie", LIES)
def test_the_lie_is_a_registered_defect_whose_rule_decides(lie: str) -> None:
    """That the rule alone finds it, and makes the release invalid, is what the tests of mutants show."""
    rule, name = LIES[lie].split()
    (mutant,) = (mutant for mutant in MUTANTS if (mutant.rule, mutant.name) == (rule, name))
    assert mutant.is_decisive
    assert CATALOGUE[rule].remedy
