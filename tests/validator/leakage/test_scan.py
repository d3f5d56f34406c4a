"""Concordance and interaction against analytic truth, and codes that each of them finds."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.gate import leakage_gate
from branchdrive.leakage.inputs import GateFeature
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.leakage.scan import Concordance, Interaction, Layout, Ranks
from branchdrive.leakage.streams import StreamColumn, Streams, ranked
from branchdrive.statistics.permutation import identity, labels

QUICK = GateProtocol(alpha=0.03, num_permutations=199, num_frequencies=8, offsets_sd=(), sparse_offsets_sd=())
NUM_ACTIONS = 6


def table(x: np.ndarray, commands: tuple[int, ...] = ()) -> Ranks:
    return Ranks.of(x, Layout(tuple(range(x.shape[2])), commands), None)


def concordance(x: np.ndarray, *subsets: int) -> float:
    rows = identity(*x.shape[:2])
    return float(Concordance.of(table(x), subsets)(rows, labels(rows))[0])


def test_groups_that_agree_are_as_surprising_as_agreement_can_be() -> None:
    x = np.broadcast_to(np.arange(float(NUM_ACTIONS))[:, None], (4, NUM_ACTIONS, 1))
    assert concordance(x, 1) == pytest.approx(2 * 3 * np.log(720))


def test_one_odd_row_in_each_of_two_groups_is_little_surprise() -> None:
    x = np.zeros((9, NUM_ACTIONS, 1))
    x[:2, 3] = 1.0
    assert concordance(x, 1) == pytest.approx(2 * np.log(6))


def test_among_many_groups_it_is_the_tail_of_friedman_s_statistic() -> None:
    x = exchangeable(400, NUM_ACTIONS, 1, seed=0)
    x[:, 0] += 0.2 * np.abs(x[:, 0])
    ranks = ranked(x)[0].astype(float)[..., 0]
    friedman = (NUM_ACTIONS - 1) * np.square(ranks.sum(axis=0)).sum() / np.square(ranks).sum()
    k = NUM_ACTIONS - 1
    assert concordance(x, 1) == pytest.approx(friedman - k - k * np.log(friedman / k), rel=0.03)


def test_groups_in_which_a_variable_differs_most_are_looked_at_alone() -> None:
    x = exchangeable(60, NUM_ACTIONS, 1, seed=1)
    x[7:13] = 1e3 * np.arange(NUM_ACTIONS)[:, None]
    everywhere, among_few = concordance(x, 1), concordance(x, 1, 10)
    assert everywhere < among_few == pytest.approx(2 * 5 * np.log(720))
    (place,) = Concordance.of(table(x), (1, 10)).places(identity(60, NUM_ACTIONS), 1)
    assert (place.columns, place.num_groups) == ((0,), 6)


def test_columns_that_differ_nowhere_or_repeat_are_left_out() -> None:
    x = exchangeable(30, NUM_ACTIONS, 2, seed=2)
    x = np.concatenate([x, np.ones((30, NUM_ACTIONS, 1)), 2 * x[..., :1]], axis=2)
    places = Concordance.of(table(x), (1,)).places(identity(30, NUM_ACTIONS), 10)
    assert {place.columns for place in places} == {(0,), (1,)}


def test_an_interaction_is_the_dependence_of_a_product_of_signs() -> None:
    x = exchangeable(50, NUM_ACTIONS, 2, seed=3)
    signs = np.sign(ranked(x)[0].astype(float)).prod(axis=2)
    sums = signs.sum(axis=0)
    expected = (NUM_ACTIONS - 1) / NUM_ACTIONS * np.square(sums - sums.mean()).sum() / signs.var(axis=1).sum()
    assert Interaction.of(table(x, (0, 1)), (0, 1))(identity(50, NUM_ACTIONS))[0] == pytest.approx(expected)


def test_without_two_commands_there_is_no_interaction() -> None:
    assert Interaction.of(table(exchangeable(9, 4, 2, seed=0)), (1,))(identity(9, 4)).tolist() == [0.0]


def streams_of(values: np.ndarray) -> Streams:
    columns = tuple(StreamColumn("evidence", "traffic_light", -5 * i) for i in range(values.shape[2]))
    return Streams(columns, *ranked(values))


def failing(x: np.ndarray, streams: Streams | None, layout: Layout | None = None) -> set[str]:
    gate = leakage_gate(x, seed=1, protocol=QUICK, streams=streams, layout=layout)
    return {test.name for test in gate.tests if test.p_adjusted <= QUICK.alpha}


def test_a_code_in_one_light_of_a_few_groups_is_found_in_streams_alone() -> None:
    x = exchangeable(46, NUM_ACTIONS, 3, seed=4)
    lights = np.zeros((46, NUM_ACTIONS, 4))
    lights[:5, :, 2] = np.arange(NUM_ACTIONS) % 3
    assert failing(x, streams_of(np.zeros_like(lights))) == set()
    assert failing(x, streams_of(lights)) == {"concordance"}


def test_streams_that_differ_are_examined_where_features_agree() -> None:
    x = np.zeros((30, NUM_ACTIONS, 3))
    code = np.broadcast_to(np.arange(float(NUM_ACTIONS))[:, None], (30, NUM_ACTIONS, 1))
    gate = leakage_gate(x, seed=1, protocol=QUICK, streams=streams_of(code))
    assert (gate.verdict, gate.bit_identical, gate.num_columns) == ("fail", False, 1)
    assert gate.codes[0].columns == (3,)


def test_a_product_of_two_commands_is_found_and_no_other_statistic_sees_it() -> None:
    rng = np.random.default_rng(5)
    x = rng.normal(size=(60, NUM_ACTIONS, 2))
    first = np.where(rng.permuted(np.tile([1, 1, 1, -1, -1, -1], (60, 1)), axis=1) > 0, 1.0, -1.0)
    x[..., 0] = first * (1 + np.abs(x[..., 0]))
    x[..., 1] = first * np.where(np.arange(NUM_ACTIONS) < 3, 1.0, -1.0) * (1 + np.abs(x[..., 1]))
    assert failing(x, None, Layout((0, 1), (0, 1))) == {"interaction"}


@pytest.mark.parametrize("kind", ["spread", "digits", "orders", "relation of columns", "relation of actions"])
def test_what_the_card_calls_not_examined_is_not_found_in_recorded_columns(kind: str) -> None:
    x = exchangeable(150, NUM_ACTIONS, 2, seed=9)
    numbers = np.arange(float(NUM_ACTIONS))
    if kind == "spread":
        x *= 1 + numbers[:, None]
    elif kind == "digits":
        x = np.floor(1e3 * x) + 0.1 * numbers[:, None]
    elif kind == "orders":
        x += 3 * np.random.default_rng(0).permuted(np.tile(numbers, (150, 1)), axis=1)[..., None]
    elif kind == "relation of columns":
        x[..., 1] = x[..., 0] + 1e-6 * numbers
    else:
        x[:, 1::2] = x[:, ::2]
    assert failing(exchangeable(150, NUM_ACTIONS, 3, seed=10), streams_of(x)) == set()


def test_times_of_a_variable_belong_together() -> None:
    features = [
        GateFeature("ego", "x_m", (-5, -5)),
        GateFeature("ego", "x_m", (0, 0)),
        GateFeature("controls", "x_m", None),
    ]
    assert Layout.of(features) == ((0, 0, 1), (2,))


def test_statistics_are_named_in_the_order_of_the_protocol() -> None:
    gate = leakage_gate(exchangeable(20, 4, 2, seed=6), seed=0, protocol=QUICK)
    assert tuple(test.name for test in gate.tests) == STATISTICS
