"""The benchmark measures something."""

from __future__ import annotations

from branchdrive_reference.bench.simulator import measure_ticks_per_s


def test_speed_is_measured() -> None:
    assert measure_ticks_per_s(num_rollouts=2, repeats=1) > 0
