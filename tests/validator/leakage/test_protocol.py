"""Numbers of gate and battery: which are refused, and what the defaults are."""

from __future__ import annotations

from typing import Any

import pytest
from tests.each import each

from branchdrive.leakage.protocol import BatteryProtocol, GateProtocol


@each(
    ("name", "value", "says"),
    [
        ("num_permutations", 0, "at least 1"),
        ("num_frequencies", 0, "at least 1"),
        ("num_folds", 1, "at least 2"),
        ("num_replicates", 0, "at least 1"),
        ("num_named", 0, "at least 1"),
        ("scratch_bytes", 0, "at least 1"),
        ("alpha", 0.0, "above 0 and below 1"),
        ("alpha", 1.0, "above 0 and below 1"),
        ("alpha", float("nan"), "above 0 and below 1"),
        ("penalty", 0.0, "above 0 and finite"),
        ("penalty", float("inf"), "above 0 and finite"),
        ("bandwidth", -1.0, "above 0 and finite"),
        ("offsets_sd", (0.0, 0.1), "above 0"),
        ("offsets_sd", (0.2, 0.1), "ascending"),
        ("offsets_sd", (0.1, 0.1), "ascending"),
    ],
)
def test_numbers_outside_of_their_range_are_refused(name: str, value: Any, says: str) -> None:
    chosen: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=f"`{name}` is .*{says}"):
        GateProtocol(**chosen)


def test_the_default_can_fail() -> None:
    protocol = GateProtocol()
    assert 4 / (protocol.num_permutations + 1) <= protocol.alpha


def test_the_defaults_are_the_papers_where_it_names_them() -> None:
    protocol = BatteryProtocol()
    assert (protocol.alpha, protocol.num_permutations, protocol.num_resamples) == (0.05, 10_000, 2_000)


@each(
    ("name", "value"),
    [
        ("alpha", 0.0),
        ("alpha", 1.0),
        ("control_alpha", -0.1),
        ("num_permutations", 0),
        ("num_resamples", 0),
        ("penalty", 0.0),
        ("offset_sd", float("inf")),
        ("score_atol", -1e-9),
    ],
)
def test_numbers_out_of_range_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"`{name}` is"):
        BatteryProtocol(**{name: value})
