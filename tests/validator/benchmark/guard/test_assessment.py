"""Guards side by side: whose groups decide what, what takes no part, and what order must not change."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validator.benchmark.guard.banks import banks

from branchdrive.benchmark.guard.assessment import SELECTIONS, Assessment, assess
from branchdrive.benchmark.guard.data import GuardData, GuardPartitions, Limits, Setting
from branchdrive.benchmark.guard.path import multiplier_grid
from branchdrive.benchmark.guard.risk import FEATURES, RiskFit
from branchdrive.driving.target import Targets
from branchdrive.driving.utility import PROFILES, fit_scale

K = len(FEATURES)
SCALE = fit_scale(banks(80, seed=30).outcomes)
BY_MARGIN = [-1.0 if feature.name == "margin_in_spreads" else 0.0 for feature in FEATURES]
FIT = RiskFit(
    features=tuple(feature.name for feature in FEATURES),
    tolerance_m=0.25,
    spread_m=0.3,
    centre=(0.0,) * K,
    spread=(1.0,) * K,
    logistic=tuple(BY_MARGIN),
    logistic_offset=0.0,
    severity=(0.0,) * K,
    severity_offset=0.0,
    grids={"balanced": {"dual_multiplier": 0.3, "multipliers": multiplier_grid(0.3)}},
)


def partition(num_groups: int, seed: int, per_cluster: int = 1) -> GuardData:
    found = banks(num_groups, seed=seed, per_cluster=per_cluster)
    return GuardData(
        found.scalars, found.outcomes, [f"group-{place:03}" for place in range(num_groups)], found.clusters
    )


VALIDATION, CALIBRATION, TEST = partition(88, 31), partition(96, 32), partition(60, 33, 2)


def assessed(
    *,
    validation: GuardData = VALIDATION,
    calibration: GuardData = CALIBRATION,
    test: GuardData = TEST,
    nominal: int = 0,
    action_prior: int = 3,
    limits: Limits | None = None,
) -> Assessment:
    setting = Setting(
        "balanced",
        PROFILES["balanced"],
        SCALE,
        nominal=nominal,
        action_prior=action_prior,
        seed=1,
        num_resamples=200,
        limits=limits or Limits(),
    )
    return assess(FIT, GuardPartitions(validation, calibration, test), setting)


def taken(data: GuardData, groups: list[int], candidates: list[int]) -> GuardData:
    values = data.outcomes.values[groups][:, candidates]
    return GuardData(
        data.scalars[:, groups][:, :, candidates],
        Targets(values, np.isfinite(values)),
        [data.groups[place] for place in groups],
        [data.clusters[place] for place in groups],
    )


def test_both_guards_stand_side_by_side() -> None:
    found = assessed()
    assert list(found.selections) == list(found.figures) == list(SELECTIONS)
    assert (found.margin.rank, found.margin.num_groups) == (84, 88)
    assert found.margin_validation.covered_groups >= 84 / 88
    assert found.conformal.refusal is found.learn_then_test.refusal is None
    assert (found.conformal.num_clusters, found.learn_then_test.num_groups) == (96, 96)


def test_the_path_ends_at_nominal_and_at_the_unguarded_selector() -> None:
    found = assessed()
    assert set(found.selections["nominal"].tolist()) == {0}
    assert found.figures["nominal"]["retained_gain"].value == 0
    assert found.figures["unguarded"]["retained_gain"].value == 1
    for name, curve in (("violation", found.trade_off.violation), ("intervention", found.trade_off.intervention)):
        assert curve[0] == 0
        assert curve[-1] == pytest.approx(found.figures["unguarded"][name].value)
        assert curve[found.conformal.place] == pytest.approx(found.figures["conformal"][name].value)
    assert found.trade_off.gain[-1] == pytest.approx(found.figures["unguarded"]["gain"].value)


def test_a_guard_lies_between_nominal_and_unguarded() -> None:
    found = assessed()
    rate = {name: figure["violation"].value for name, figure in found.figures.items()}
    assert rate["nominal"] == 0
    assert 0 < (rate["conformal"] or 0) < (rate["unguarded"] or 0)
    retained = found.figures["conformal"]["retained_gain"].value
    assert retained is not None
    assert 0.1 < retained < 1


def test_each_partition_has_its_one_part() -> None:
    whole = assessed()
    other_test = assessed(test=partition(40, 35))
    assert other_test.margin == whole.margin
    assert other_test.conformal.curve.tolist() == whole.conformal.curve.tolist()
    other_calibration = assessed(calibration=partition(96, 36))
    assert other_calibration.margin == whole.margin
    assert other_calibration.selections["global_margin"].tolist() == whole.selections["global_margin"].tolist()
    other_validation = assessed(validation=partition(88, 37))
    assert other_validation.margin != whole.margin
    assert other_validation.selections["conformal"].tolist() == whole.selections["conformal"].tolist()


def test_too_few_calibration_groups_leave_the_guard_nominal() -> None:
    found = assessed(calibration=partition(87, 32))
    assert found.conformal.refusal is not None
    assert set(found.selections["conformal"].tolist()) == {0}


def test_limits_are_those_that_are_given() -> None:
    less = assessed(calibration=partition(60, 32), limits=Limits(min_groups=60, min_clusters=60))
    assert less.conformal.refusal is less.learn_then_test.refusal is None
    assert assessed(calibration=partition(60, 32), limits=Limits(min_clusters=60)).conformal.refusal is not None
    assert assessed(limits=Limits(coverage=0.5)).margin.rank == 44
    assert assessed(limits=Limits(alpha=0.2, delta=0.3)).conformal.place > assessed().conformal.place
    with pytest.raises(ValueError, match=r"fitted for a tolerance of 0.25 m, not 0.5 m"):
        assessed(limits=Limits(tolerance_m=0.5))


def test_action_prior_is_the_same_candidate_everywhere() -> None:
    found = assessed().figures["action_prior"]
    lost = TEST.outcomes.values[:, 3, 1] < TEST.outcomes.values[:, 0, 1] - 0.25
    assert set(assessed().selections["action_prior"].tolist()) == {3}
    assert found["violation"].value == pytest.approx(lost.mean())
    assert found["intervention"] == (1, None, None, 0)
    assert assessed(action_prior=0).figures["action_prior"]["violation"] == (0, None, None, 0)


def test_what_follows_from_a_selection_has_no_interval() -> None:
    """Nominal loses nothing by definition, a margin that accepts nothing by what was seen."""
    found = assessed(calibration=partition(87, 32))
    for name in ("nominal", "conformal"):
        assert found.figures[name]["violation"] == found.figures[name]["intervention"] == (0, None, None, 0)
    vacuous = assessed(validation=VALIDATION._replace(scalars=VALIDATION.scalars + 100)).figures["global_margin"]
    assert vacuous["intervention"].value == 0
    assert 0.05 < (vacuous["intervention"].high or 0) < 0.2
    assert vacuous["gain"][:3] == (0, None, None)


def test_the_path_counts_violations_by_groups_and_by_clusters() -> None:
    found = assessed()
    for name in ("violation", "violation_of_clusters"):
        path = getattr(found.trade_off, name)
        assert path[-1] == pytest.approx(found.figures["unguarded"][name].value)
        assert path[found.conformal.place] == pytest.approx(found.figures["conformal"][name].value)


def test_groups_without_a_separation_take_no_part_and_are_counted() -> None:
    def holed(data: GuardData, *places: int) -> GuardData:
        values = data.outcomes.values.copy()
        values[list(places), 3, 1] = np.nan
        return data._replace(outcomes=Targets(values, np.isfinite(values)))

    found = assessed(validation=holed(VALIDATION, 1), calibration=holed(CALIBRATION, 2, 3), test=holed(TEST, 4, 5, 6))
    assert dict(found.num_left_out) == {"validation": 1, "calibration": 2, "test": 3}
    assert (found.margin.num_groups, found.conformal.num_groups, len(found.selections["nominal"])) == (87, 94, 57)
    assert np.flatnonzero(~found.kept).tolist() == [4, 5, 6]


def test_orders_of_groups_and_candidates_do_not_matter() -> None:
    rng = np.random.default_rng(5)
    candidates = rng.permutation(13).tolist()
    orders = [rng.permutation(len(data.groups)).tolist() for data in (VALIDATION, CALIBRATION, TEST)]
    moved = [
        taken(data, order, candidates) for data, order in zip((VALIDATION, CALIBRATION, TEST), orders, strict=True)
    ]
    here = assessed()
    there = assessed(
        validation=moved[0],
        calibration=moved[1],
        test=moved[2],
        nominal=candidates.index(0),
        action_prior=candidates.index(3),
    )
    assert there.margin.margin_m == pytest.approx(here.margin.margin_m)
    assert (there.conformal.place, there.learn_then_test.place) == (here.conformal.place, here.learn_then_test.place)
    for name, chosen in here.selections.items():
        assert np.array(candidates)[there.selections[name]].tolist() == chosen[orders[2]].tolist()
        for figure, value in here.figures[name].items():
            assert there.figures[name][figure] == pytest.approx(value)


def test_broken_partitions_are_refused() -> None:
    with pytest.raises(ValueError, match="do not match"):
        assessed(test=TEST._replace(scalars=TEST.scalars[:, 1:]))
    with pytest.raises(ValueError, match="59 groups and 60 clusters do not match 60 outcomes"):
        assessed(test=TEST._replace(groups=TEST.groups[1:]))
    nothing = np.full((60, 13, 6), np.nan)
    with pytest.raises(ValueError, match=r"^none of 60 groups has every utility and separation"):
        assessed(test=TEST._replace(outcomes=Targets(nothing, np.isfinite(nothing))))
