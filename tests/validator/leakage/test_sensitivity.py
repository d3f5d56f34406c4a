"""Minimum detectable effect: where offsets go, and how often they are found."""

from __future__ import annotations

import numpy as np
import pytest
from tests.validator.leakage.samples import exchangeable

from branchdrive.leakage.draw import KeptHere
from branchdrive.leakage.gate_statistics import GateStatistics
from branchdrive.leakage.protocol import GateProtocol
from branchdrive.leakage.sensitivity import PATTERNS, Detection, Sensitivity, inject, offsets_of, sensitivity
from branchdrive.statistics.permutation import critical_value

PROTOCOL = GateProtocol(
    num_permutations=399, alpha=0.03, num_frequencies=32, offsets_sd=(1e-4, 0.8, 2.0), sparse_offsets_sd=(1e-4, 30.0),
    num_replicates=4,
)  # fmt: skip


def measured(x: np.ndarray, protocol: GateProtocol = PROTOCOL) -> Sensitivity:
    statistics = GateStatistics.of(x, protocol, seed=1)
    null = statistics.null(protocol.num_permutations, seed=1, scratch_bytes=protocol.scratch_bytes)
    found = sensitivity(KeptHere(x), statistics.reference, null, protocol=protocol, seed=1)
    assert found.critical == tuple(critical_value(column, protocol.alpha / 6) for column in null.T)
    return found


def test_one_offset_moves_one_feature_of_one_action() -> None:
    x = np.zeros((3, 4, 5))
    inject(x, "one", np.arange(5.0), np.array([3, 1, 2]), 2)
    expected = np.zeros((3, 4, 5))
    expected[:, 2, 3] = 3.0
    np.testing.assert_array_equal(x, expected)


def test_a_dense_offset_grows_with_the_action_on_a_quarter_of_the_features() -> None:
    x = np.zeros((3, 5, 8))
    inject(x, "dense", np.full(8, 2.0), np.array([6, 1, 0, 2, 3, 4, 5, 7]), 0)
    assert np.flatnonzero(x.any(axis=(0, 1))).tolist() == [1, 6]
    np.testing.assert_allclose(x[0, :, 6], [-2, -1, 0, 1, 2])


def test_unavailable_stays_unavailable() -> None:
    x = np.full((2, 3, 1), np.nan)
    inject(x, "dense", np.ones(1), np.array([0]), 0)
    assert np.isnan(x).all()


def test_large_offsets_are_found_and_tiny_ones_are_not() -> None:
    found = measured(exchangeable(80, 6, 8, seed=0))
    assert found.alpha == 0.005
    assert [(d.pattern, d.offset_sd) for d in found.detections] == [
        (pattern, offset) for pattern in PATTERNS for offset in offsets_of(pattern, PROTOCOL)
    ]
    for detection in found.detections:
        assert detection.gate_share >= max(detection.shares)
        if detection.offset_sd == 1e-4:
            assert detection.gate_share <= 0.25
        if detection.offset_sd == 2.0:
            assert detection.gate_share == 1.0
    for pattern in ("one", "dense"):
        assert found.smallest_sd(pattern) in (0.8, 2.0)
    assert found.smallest_sd("tenth") == 30.0
    assert found.smallest_sd("thirtieth") == 30.0


def test_a_leak_in_the_data_does_not_pass_for_a_found_offset() -> None:
    x = exchangeable(80, 6, 8, seed=0)
    x[:, 3, 2] += 50.0
    found = measured(x)
    assert all(d.gate_share <= 0.25 for d in found.detections if d.offset_sd == 1e-4)


def test_too_few_permutations_find_nothing() -> None:
    found = measured(
        exchangeable(40, 4, 3, seed=0), GateProtocol(num_permutations=99, num_frequencies=8, num_replicates=1)
    )
    assert found.critical == (np.inf,) * 6
    assert {d.gate_share for d in found.detections} == {0.0}
    assert found.smallest_sd("one") is None


def test_an_offset_needs_a_feature_to_move() -> None:
    x = np.zeros((20, 4, 2))
    x[::2, 1, 0] = np.nan
    found = measured(x)
    assert {d.gate_share for d in found.detections} == {0.0}
    assert found.smallest_sd("dense") is None


@pytest.mark.parametrize(
    ("shares", "expected"),
    [((0, 0, 1, 1), 0.4), ((1, 0, 1, 1), 0.4), ((1, 1, 1, 1), 0.1), ((0, 1, 1, 0.8), None), ((0, 0, 0, 1), 0.8)],
)
def test_the_smallest_offset_is_one_above_which_nothing_is_missed(
    shares: tuple[float, ...], expected: float | None
) -> None:
    rows = zip((0.1, 0.2, 0.4, 0.8), shares, strict=True)
    found = Sensitivity(0.1, (0.0,) * 4, tuple(Detection("one", offset, (share,) * 4, share) for offset, share in rows))
    assert found.smallest_sd("one") == expected
    assert found.smallest_sd("dense") is None
