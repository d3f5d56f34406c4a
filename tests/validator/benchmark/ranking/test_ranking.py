"""The whole ranking: who is ranked, all selectors, and what must not change it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.validator.benchmark.guard.banks import Banks, banks

from branchdrive.benchmark.ranking.measure import best_fixed
from branchdrive.benchmark.ranking.ranking import SEPARATION, Ranking, rank
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, Scale, fit_scale, utility

TRAIN = banks(60, seed=1)
TEST = banks(30, seed=2)
SCALE = fit_scale(TRAIN.outcomes)
BALANCED = PROFILES["balanced"]


def ranked(found: Banks = TEST, *, nominal: int = 0, profile: str = "balanced", brake: int | None = 5) -> Ranking:
    predictions = {"M3": found.scalars}
    return rank(
        found.outcomes,
        predictions,
        scale=SCALE,
        profile=PROFILES[profile],
        nominal=nominal,
        action_prior=nominal,
        fixed_brake=brake,
    )


def test_all_selectors_have_their_row() -> None:
    found = ranked()
    assert list(found.entries) == ["random", "nominal", "action_prior", "fixed_brake", "O-M3", "oracle"]
    assert "fixed_brake" not in ranked(brake=None).entries
    assert [len(entry.seeds) for entry in found.entries.values()] == [1, 1, 1, 1, 3, 1]
    assert [entry.agreement is None for entry in found.entries.values()] == [True, True, True, True, False, True]


@pytest.mark.parametrize("profile", PROFILES)
def test_a_good_prediction_lies_between_nominal_and_oracle(profile: str) -> None:
    entries = ranked(profile=profile).entries
    value = {name: entry.measures.value.mean() for name, entry in entries.items()}
    assert value["random"] < value["O-M3"] < value["oracle"]
    assert value["nominal"] <= value["O-M3"]
    captured = entries["O-M3"].captured
    assert captured is not None
    assert 0 < captured < 1
    assert entries["oracle"].captured == pytest.approx(1)


def test_a_perfect_prediction_is_the_oracle() -> None:
    found = rank(
        TEST.outcomes, {"M3": TEST.outcomes.values[None]}, scale=SCALE, profile=BALANCED, nominal=0, action_prior=0
    )
    for one, other in zip(found.entries["O-M3"].measures, found.entries["oracle"].measures, strict=True):
        assert one.tolist() == other.tolist()


def test_random_chooses_every_candidate_and_fixed_ones_one() -> None:
    counts = {name: entry.num_actions for name, entry in ranked().entries.items()}
    assert counts["random"] == (13,)
    assert counts["nominal"] == counts["fixed_brake"] == (1,)
    assert all(1 < count <= 13 for count in counts["O-M3"])


def test_each_seed_selects_for_itself() -> None:
    entry = ranked().entries["O-M3"]
    scores = [best.value for best in entry.seeds]
    assert entry.measures.value == pytest.approx(np.mean(scores, axis=0))
    assert set(np.unique(np.round(entry.shares * 3, 9))) <= {0, 1, 2, 3}


def test_groups_without_a_utility_leave_and_are_counted() -> None:
    values = TEST.outcomes.values.copy()
    values[3, 4, SEPARATION] = np.nan
    values[5, 0, SEPARATION] = np.nan
    values[5, 2, 3] = np.nan
    values[7, 2, 3] = np.nan
    values[9, :, 0] = np.nan
    found = ranked(Banks(Targets(values, np.isfinite(values)), TEST.scalars, TEST.clusters))
    assert np.flatnonzero(~found.population.ranked).tolist() == [3, 5, 7]
    assert (found.population.num_without_separation, found.population.num_without_other) == (2, 1)
    assert len(found.utilities) == len(found.entries["O-M3"].measures.value) == 27
    whole = ranked()
    kept = found.population.ranked
    assert found.entries["O-M3"].measures.value == pytest.approx(whole.entries["O-M3"].measures.value[kept])


def test_action_prior_and_fixed_brake_come_from_means() -> None:
    utilities = utility(TRAIN.outcomes, SCALE, BALANCED)
    assert best_fixed(utilities) == int(utilities.mean(axis=0).argmax())
    assert best_fixed(utilities, among=range(4, 7)) == 4 + int(utilities.mean(axis=0)[4:7].argmax())


@settings(max_examples=20)
@given(st.permutations(range(30)), st.permutations(range(13)))
def test_orders_of_groups_and_candidates_do_not_matter(groups: list[int], candidates: list[int]) -> None:
    values = TEST.outcomes.values[groups][:, candidates]
    moved = Banks(
        Targets(values, np.isfinite(values)),
        TEST.scalars[:, groups][:, :, candidates],
        tuple(TEST.clusters[place] for place in groups),
    )
    there = ranked(moved, nominal=candidates.index(0), brake=candidates.index(5))
    for name, entry in ranked().entries.items():
        for one, other in zip(entry.measures, there.entries[name].measures, strict=True):
            np.testing.assert_allclose(other, one[groups], atol=1e-9)
        assert there.entries[name].gate.mean_m == pytest.approx(entry.gate.mean_m)


def test_broken_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^predictions of 'M3' have shape \[3, 29, 13, 6\]"):
        ranked(Banks(TEST.outcomes, TEST.scalars[:, 1:], TEST.clusters))
    nothing = np.full((2, 13, 6), math.nan)
    with pytest.raises(ValueError, match=r"^none of 2 groups can be ranked"):
        ranked(Banks(Targets(nothing, np.isfinite(nothing)), TEST.scalars[:, :2], ("a", "b")))
    with pytest.raises(ValueError, match="none of 30 groups can be ranked"):
        rank(
            TEST.outcomes,
            {"M3": TEST.scalars},
            scale=Scale(*np.where([[True, False, False, False, False]] * 2, np.nan, SCALE)),
            profile=BALANCED,
            nominal=0,
            action_prior=0,
        )
