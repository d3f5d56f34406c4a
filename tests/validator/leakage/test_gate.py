"""The gate: verdicts, places, and what it refuses to call a pass."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.gate import Gate, leakage_gate
from branchdrive.leakage.protocol import STATISTICS, GateProtocol
from branchdrive.statistics.holm import holm

QUICK = GateProtocol(num_permutations=999, alpha=0.01, num_frequencies=32, offsets_sd=(0.8,), num_replicates=1)


def judged(x: NDArray[np.float64], protocol: GateProtocol = QUICK, seed: int = 5) -> Gate:
    return leakage_gate(x, seed=seed, protocol=protocol)


def p_of(gate: Gate) -> dict[str, float]:
    return {test.name: test.p for test in gate.tests}


def test_exchangeable_features_pass_and_say_what_would_have_failed() -> None:
    gate = judged(exchangeable(80, 6, 5, seed=0))
    assert (gate.verdict, gate.bit_identical, gate.shape) == ("pass", False, (80, 6, 5))
    assert tuple(test.name for test in gate.tests) == STATISTICS
    np.testing.assert_array_equal([test.p_adjusted for test in gate.tests], holm([test.p for test in gate.tests]))
    assert gate.sensitivity is not None
    assert gate.sensitivity.alpha == 0.01 / 6
    assert gate.bandwidth is not None


def test_a_planted_offset_fails_and_is_named() -> None:
    x = exchangeable(200, 6, 5, seed=1)
    x[:, 4, 3] += 1.5
    gate = judged(x)
    assert gate.verdict == "fail"
    place = gate.places[0]
    assert (place.feature, place.action, place.kind) == (3, 4, "value")
    assert place.p == 0.001
    assert place.t > 4
    expected = x[:, 4, 3].mean() - np.delete(x[:, :, 3], 4, axis=1).mean()
    robust_sd = 1.4826 * np.median(np.abs(x[:, :, 3] - np.median(x[:, :, 3], axis=1, keepdims=True)))
    assert place.difference == pytest.approx(expected / robust_sd, rel=0.35)


def test_a_planted_spread_fails_and_is_named() -> None:
    x = exchangeable(200, 6, 5, seed=2)
    x[:, 1, 2] = x[:, :, 2].mean(axis=1) + 2.5 * (x[:, 1, 2] - x[:, :, 2].mean(axis=1))
    gate = judged(x)
    assert gate.verdict == "fail"
    assert p_of(gate)["max_t"] == p_of(gate)["ridge"] == 0.001
    place = gate.places[0]
    assert (place.feature, place.action, place.kind) == (2, 1, "deviation")
    assert place.difference > 0.3


def test_a_leak_spread_thin_is_found_by_what_adds_up() -> None:
    x = exchangeable(150, 6, 12, seed=3)
    x += 0.25 * np.median(np.abs(x - np.median(x, axis=1, keepdims=True))) * np.linspace(-1, 1, 6)[:, None]
    gate = judged(x)
    assert gate.verdict == "fail"
    assert min(p_of(gate)["hsic"], p_of(gate)["ridge"]) == 0.001


def test_availability_alone_leaks() -> None:
    x = exchangeable(60, 6, 3, seed=4)
    x[:, 2, 1] = np.nan
    gate = judged(x)
    assert gate.verdict == "fail"
    assert (gate.places[0].feature, gate.places[0].action, gate.places[0].kind) == (1, 2, "unavailable")
    assert gate.places[0].difference == pytest.approx(1.0, rel=1e-3)


def test_availability_at_random_passes() -> None:
    x = exchangeable(60, 6, 3, seed=5)
    x[np.random.default_rng(0).random(x.shape) < 0.2] = np.nan
    x[7] = np.nan
    assert judged(x).verdict == "pass"


@pytest.mark.parametrize("value", [0.0, 3.5, np.nan, np.inf])
def test_bit_identical_replays_pass_exactly(value: float) -> None:
    x = np.broadcast_to(exchangeable(9, 1, 4, seed=0), (9, 12, 4)).copy()
    x[:, :, 1] = value
    gate = judged(x)
    assert (gate.verdict, gate.bit_identical) == ("pass", True)
    assert [(test.p, test.p_adjusted) for test in gate.tests] == [(1.0, 1.0)] * 6
    assert gate.places == ()
    assert gate.sensitivity is None


def test_one_bit_is_not_identical() -> None:
    x = np.ones((9, 12, 4))
    x[2, 3, 1] = np.nextafter(1.0, 2.0)
    gate = judged(x)
    assert not gate.bit_identical
    assert gate.verdict == "pass"


def test_one_bit_in_every_group_at_the_same_action_fails() -> None:
    x = np.ones((9, 12, 4))
    x[:, 3, 1] = np.nextafter(1.0, 2.0)
    gate = judged(x)
    assert gate.verdict == "fail"
    assert (gate.places[0].feature, gate.places[0].action) == (1, 3)


@pytest.mark.parametrize(
    ("x", "protocol", "reason"),
    [
        (np.zeros((0, 12, 4)), QUICK, "nothing to examine"),
        (np.zeros((9, 12, 0)), QUICK, "nothing to examine"),
        (exchangeable(4, 12, 2, seed=0), QUICK, "4 groups cannot fill 5 folds"),
        (
            exchangeable(30, 4, 2, seed=0),
            GateProtocol(num_permutations=999, num_frequencies=8, num_replicates=1),
            "at best",
        ),
    ],
)
def test_what_cannot_fail_is_inconclusive(x: NDArray[np.float64], protocol: GateProtocol, reason: str) -> None:
    gate = judged(x, protocol)
    assert gate.verdict == "inconclusive"
    assert reason in gate.reason


def test_the_same_seed_gives_the_same_result_in_any_chunks() -> None:
    x = exchangeable(40, 5, 3, seed=6)
    first, other = judged(x), judged(x, seed=6)
    small = judged(x, GateProtocol(**{**vars(QUICK), "scratch_bytes": 50_000}))
    assert [test.p for test in small.tests] == [test.p for test in first.tests]
    assert small.places == first.places
    assert judged(x) == first
    assert [test.p for test in other.tests] != [test.p for test in first.tests]


def test_renamed_actions_are_found_under_their_new_names() -> None:
    x = exchangeable(100, 4, 3, seed=7)
    x[:, 1, 2] += 2.0
    order = [2, 3, 1, 0]
    first, renamed = judged(x), judged(x[:, order])
    assert first.verdict == renamed.verdict == "fail"
    assert [test.observed for test in renamed.tests[:2]] == pytest.approx([t.observed for t in first.tests[:2]])
    assert order[renamed.places[0].action] == first.places[0].action == 1


def test_the_default_protocol_judges_a_small_release() -> None:
    x = exchangeable(40, 12, 4, seed=8)
    x[:, 5, 0] += 4.0
    gate = leakage_gate(x, seed=11)
    assert gate.verdict == "fail"
    assert min(test.p for test in gate.tests) == 1e-4
    assert (gate.places[0].feature, gate.places[0].action) == (0, 5)


@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(1, 8), st.integers(2, 4), st.integers(1, 3)),
        elements=st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1.0, -3.5, 1e308, -1e308, 5e-324, 1e-160]),
    )
)
def test_no_number_breaks_it(x: NDArray[np.float64]) -> None:
    gate = judged(x, GateProtocol(num_permutations=19, alpha=0.5, num_frequencies=4, num_replicates=1))
    assert all(np.isfinite(test.observed) and 0 < test.p <= test.p_adjusted <= 1 for test in gate.tests)
    assert all(np.isfinite([place.t, place.difference]).all() for place in gate.places)
    if gate.tests:
        assert gate.verdict == ("fail" if min(test.p_adjusted for test in gate.tests) <= 0.5 else "pass")


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(ValueError, match="features have shape"):
        leakage_gate(np.zeros((3, 4)), seed=0)
    with pytest.raises(ValueError, match="`seed` is -1"):
        leakage_gate(exchangeable(9, 3, 1, seed=0), seed=-1)
