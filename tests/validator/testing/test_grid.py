"""What an invented drive records is the same on every processor, since it lies on a grid of binary fractions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.scenes import SCENES

from branchdrive.formats.parquet import encode_table
from branchdrive.testing.drive import angle_on_grid, on_grid, plans
from branchdrive.testing.group import make_group


def _recorded() -> list[bytes]:
    groups = [make_group(index, scene, plans(index)[:4]) for index, scene in enumerate(SCENES)]
    return [encode_table(group[name]) for group in groups for name in sorted(group)]


@pytest.mark.parametrize("name", ["sin", "cos", "tan", "arctan", "arctan2", "hypot"])
@pytest.mark.parametrize("towards", [-10.0, 10.0])
def test_the_last_bit_of_a_function_changes_no_byte(name: str, towards: float, monkeypatch: pytest.MonkeyPatch) -> None:
    expected, exact = _recorded(), getattr(np, name)
    monkeypatch.setattr(np, name, lambda *values: np.nextafter(exact(*values), towards))
    assert _recorded() == expected


@pytest.mark.parametrize("table", ["observations", "actors"])
def test_states_lie_on_the_grid(table: str) -> None:
    rows = make_group(1, SCENES[1])[table]
    names = [name for name in rows.column_names if name.endswith(("_m", "_rad", "_mps", "_mps2", "_radps"))]
    assert len(names) >= 8
    for name in names:
        values = rows[name].to_numpy() * 4096
        assert np.array_equal(values, np.round(values)), name


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, math.pi - 1e-5])
def test_angles_stay_within_half_a_turn(angle: float) -> None:
    """Rounded to the nearest, those beside half a turn would be beyond it."""
    assert math.pi - 1 / 4096 < abs(float(angle_on_grid(angle))) <= math.pi


def test_no_zero_is_negative() -> None:
    assert not np.signbit(on_grid([-1e-9, -0.0, 0.0])).any()
