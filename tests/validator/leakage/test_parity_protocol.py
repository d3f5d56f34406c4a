"""Numbers of the paper's battery."""

from __future__ import annotations

from typing import Any

import pytest
from tests.each import each

from branchdrive.leakage.parity_protocol import ParityProtocol


def test_the_defaults_are_the_papers_where_it_names_them() -> None:
    protocol = ParityProtocol()
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
        ParityProtocol(**{name: value})
