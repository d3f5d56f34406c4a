"""The script of a group is a pure function of its descriptor, and its rates are those that were asked for."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from itertools import product

import pytest

from branchdrive.contract.bank import load_action_bank
from branchdrive_reference.collect.campaign import collection_descriptor
from branchdrive_reference.collect.fault import ATTEMPT_FAULTS, FAILURES, Fault
from branchdrive_reference.collect.plan import PRESETS
from branchdrive_reference.collect.script import (
    MAX_ATTEMPTS,
    NUM_NOMINAL_REPLAYS,
    Attempt,
    GroupScript,
    group_script,
    replay_key,
)

SEED = 5
BANK = load_action_bank()
PAPER_GROUPS = PRESETS["paper"].num_groups
TREATMENT_FAULTS = {Fault.EARLY_BRANCH, Fault.LATE_BRANCH, Fault.WRONG_DURATION, Fault.TRUNCATED_LOG}


def script_of(index: int = 0, seed: int = SEED, **rates: float) -> GroupScript:
    return group_script(collection_descriptor(seed, faults=rates), index)


def attempts_of(script: GroupScript) -> list[Attempt]:
    return [*script.nominal, *script.replays]


def chains_of(script: GroupScript) -> dict[tuple[str, str], list[Attempt]]:
    chains: dict[tuple[str, str], list[Attempt]] = defaultdict(list)
    for attempt in attempts_of(script):
        chains[attempt.role, attempt.policy.key].append(attempt)
    return chains


def faults_of(script: GroupScript) -> set[Fault]:
    return {fault for attempt in attempts_of(script) for fault in attempt.faults}


def test_without_faults_every_policy_has_one_attempt() -> None:
    script = script_of()
    assert [attempt.policy for attempt in script.nominal] == [BANK.nominal]
    assert [attempt.role for attempt in script.replays] == ["intervention"] * 12 + ["nominal_replay"] * 2
    assert [attempt.policy for attempt in script.replays] == [*BANK.interventions, BANK.nominal, BANK.nominal]
    assert [attempt.number for attempt in script.replays] == [1] * 12 + [1, NUM_NOMINAL_REPLAYS]
    assert (faults_of(script), script.stopped_because) == (set(), "")


def test_equal_keys_give_equal_scripts() -> None:
    descriptor = collection_descriptor(SEED, faults=PRESETS["paper"].faults)
    scripts = [group_script(descriptor, index) for index in range(50)]
    assert [group_script(descriptor, index) for index in reversed(range(50))] == scripts[::-1]
    assert [script_of(index, SEED + 1, **PRESETS["paper"].faults) for index in range(50)] != scripts


def test_a_draw_does_not_depend_on_the_other_faults() -> None:
    both = {"late_branch": 0.3, "online_steering": 0.5}
    for index in range(20):
        late = {a.key for a in attempts_of(script_of(index, late_branch=0.3)) if a.fault}
        assert {a.key for a in attempts_of(script_of(index, **both)) if a.fault} == late


def test_replay_keys_are_positive_and_different() -> None:
    cases = list(product(("nominal", "intervention", "nominal_replay"), (0, 1, 12, 255), (1, 2, 99_999, 100_000)))
    keys = {replay_key(role, index, attempt) for role, index, attempt in cases}
    assert len(keys) == len(cases)
    assert min(keys) == 1
    assert max(keys) < 2**63


def test_the_attempts_of_a_group_have_keys_of_their_own() -> None:
    for index in range(50):
        attempts = attempts_of(script_of(index, **PRESETS["paper"].faults))
        assert len({attempt.key for attempt in attempts}) == len(attempts)


@pytest.mark.parametrize("fault", FAILURES)
def test_a_failed_attempt_is_repeated_up_to_the_third(fault: Fault) -> None:
    script = script_of(**{fault: 1.0})
    assert [(attempt.number, attempt.fault) for attempt in script.nominal] == [(n + 1, fault) for n in range(3)]
    assert MAX_ATTEMPTS == 3
    assert script.replays == ()
    assert script.stopped_because == "no attempt at nominal succeeded: 3 made"


def test_an_unretried_failure_is_the_last_attempt() -> None:
    assert len(script_of(partial=1.0, unretried=1.0).nominal) == 1


def test_a_policy_that_is_given_up_ends_the_group() -> None:
    scripts = [script_of(index, partial=0.2, unretried=1.0) for index in range(200)]
    for script in scripts:
        chains = list(chains_of(script).values())
        lost = [chain for chain in chains if chain[0].role != "nominal_replay" and all(a.is_failure for a in chain)]
        assert lost in ([], [chains[-1]])
        assert bool(lost) == bool(script.stopped_because)


def test_a_duplicate_follows_the_first_complete_attempt_once() -> None:
    script = script_of(duplicate=1.0)
    chains = chains_of(script)
    assert {len(chain) for (role, _), chain in chains.items() if role != "nominal_replay"} == {2}
    assert [attempt.number for attempt in chains["nominal_replay", "nominal"]] == [1, 2, 3, 4]


def test_a_retried_policy_ends_with_a_complete_attempt_and_its_duplicate_at_most() -> None:
    for index in range(200):
        for chain in chains_of(script_of(index, partial=0.3, duplicate=0.5)).values():
            if chain[0].role != "nominal_replay":
                first = next((i for i, attempt in enumerate(chain) if not attempt.is_failure), MAX_ATTEMPTS - 1)
                assert len(chain) - first in (1, 2)


def test_an_abandoned_group_has_no_complete_bank() -> None:
    begun = [len(chains_of(script_of(index, abandoned=1.0))) for index in range(1000)]
    assert (min(begun), max(begun) < len(BANK.policies)) == (1, True)
    assert sum(begun) / len(begun) == pytest.approx(2.0, abs=0.15)  # 1 + 1/2 + 1/4 + ..
    assert script_of(abandoned=1.0).stopped_because == f"abandoned after {begun[0]} of 13 policies"
    assert not any(a.role == "nominal_replay" for a in attempts_of(script_of(abandoned=1.0)))


def test_one_intervention_disagrees_about_the_seed() -> None:
    places = set()
    for index in range(100):
        odd = [
            a for a in attempts_of(script_of(index, seed_disagreement=1.0, duplicate=1.0)) if a.other_seed is not None
        ]
        assert {a.role for a in odd} == {"intervention"}
        assert len({(a.policy.key, a.other_seed) for a in odd}) == 1
        assert [a.number for a in odd] == [1, 2]
        places.add(odd[0].policy.key)
    assert places == {policy.key for policy in BANK.interventions}


def test_all_acceleration_keeps_the_online_steering() -> None:
    steered = {a.policy.key for a in attempts_of(script_of(online_steering=1.0)) if a.keeps_steering}
    assert steered == {policy.key for policy in BANK.policies if policy.family == "accelerate"}


@pytest.mark.parametrize("fault", ATTEMPT_FAULTS)
def test_only_failures_befall_attempts_that_do_not_intervene(fault: Fault) -> None:
    roles = {a.role for index in range(100) for a in attempts_of(script_of(index, **{fault: 0.2})) if a.fault}
    assert roles == {"nominal", "intervention", "nominal_replay"} if fault in FAILURES else {"intervention"}


@pytest.mark.parametrize("fault", ATTEMPT_FAULTS)
def test_rates_of_attempts_are_those_that_were_asked_for(fault: Fault) -> None:
    scripts = [script_of(index, **{fault: 0.05}) for index in range(400)]
    drawn = [a.fault is fault for script in scripts for a in attempts_of(script) if a.role == "intervention"]
    assert is_share(sum(drawn), len(drawn), 0.05)


def is_share(found: float, total: float, expected: float, sigmas: float = 4.0) -> bool:
    """Whether a count lies within the sampling error of an expected share."""
    return abs(found - total * expected) <= sigmas * math.sqrt(total * expected * (1 - expected))


def analytic_funnel(rates: Mapping[str, float]) -> tuple[float, float, float]:
    """Expected shares of exact banks, of valid controls among those, and of complete windows among those.

    The arithmetic of docs/decisions/0012-faults-as-declared-rates.md.
    """
    failure = 1 - (1 - rates["partial"]) * (1 - rates["quarantined"])
    given_up = 1.0
    for _ in range(MAX_ATTEMPTS - 1):
        given_up = rates["unretried"] + (1 - rates["unretried"]) * failure * given_up
    exact = (1 - rates["abandoned"]) * (1 - failure * given_up) ** 13
    treated = math.prod(1 - rates[fault] for fault in TREATMENT_FAULTS)
    rescue = 1 - rates["duplicate"] * (1 - failure) * treated * (1 - rates["dropped_frame"])
    controls = (1 - rates["online_steering"]) * (1 - (1 - treated) * rescue) ** 12
    return exact, controls, (1 - rates["dropped_frame"] * rescue) ** 12


@pytest.fixture(scope="module")
def paper_scripts() -> list[GroupScript]:
    descriptor = collection_descriptor(SEED, faults=PRESETS["paper"].faults)
    return [group_script(descriptor, index) for index in range(PAPER_GROUPS)]


def candidates_of(script: GroupScript) -> list[Attempt]:
    """The intervention attempts that the canonical selection chooses, but for its order of rollout ids."""
    chosen = []
    for (role, _), chain in chains_of(script).items():
        if role == "intervention":
            complete = [attempt for attempt in chain if not attempt.is_failure]
            chosen.append(next((a for a in complete if a.fault is None and not a.keeps_steering), complete[0]))
    return chosen


def test_the_preset_paper_has_a_funnel_of_the_papers_shape(paper_scripts: list[GroupScript]) -> None:
    exact = [candidates_of(script) for script in paper_scripts if not script.stopped_because]
    controls = [bank for bank in exact if not any(a.keeps_steering or a.fault in TREATMENT_FAULTS for a in bank)]
    integrity = [bank for bank in controls if not any(a.fault for a in bank)]
    disagreeing = [bank for bank in integrity if any(a.other_seed is not None for a in bank)]
    expected = analytic_funnel(PRESETS["paper"].faults)
    assert is_share(len(exact), PAPER_GROUPS, expected[0])
    assert is_share(len(controls), len(exact), expected[1])
    assert is_share(len(integrity), len(controls), expected[2])
    assert len(disagreeing) <= 7  # 2 are expected: P(Poisson(2) > 7) = 0.001


def test_the_preset_paper_is_derived_from_the_papers_counts() -> None:
    exact, controls, integrity = analytic_funnel(PRESETS["paper"].faults)
    branched = 0.98  # of the groups the trigger finds a branch in
    assert branched * exact == pytest.approx(1751 / 2467, abs=0.005)
    assert controls == pytest.approx(649 / 1751, abs=0.005)
    assert integrity == pytest.approx(634 / 649, abs=0.002)
    assert 634 * PRESETS["paper"].faults["seed_disagreement"] == pytest.approx(2, abs=0.1)


def test_the_preset_paper_has_the_papers_failures_and_duplicates(paper_scripts: list[GroupScript]) -> None:
    attempts = [a for script in paper_scripts for a in attempts_of(script)]
    num_candidates = sum(a.role != "nominal_replay" for a in attempts)
    num_failed = sum(a.is_failure for a in attempts)
    chains = [chain for script in paper_scripts for chain in chains_of(script).values()]
    wanted = {"nominal": 1, "intervention": 1, "nominal_replay": NUM_NOMINAL_REPLAYS}
    num_duplicates = sum(max(0, sum(not a.is_failure for a in chain) - wanted[chain[0].role]) for chain in chains)
    assert num_candidates == pytest.approx(24_116, rel=0.08)
    assert num_failed == pytest.approx(494, rel=0.2)
    assert num_duplicates == pytest.approx(402, rel=0.2)
