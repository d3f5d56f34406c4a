"""Units by their ratios: each is named, its neighbours and right values are not."""

from __future__ import annotations

import math

import pytest

from branchdrive.driving.unit import wrong_unit


@pytest.mark.parametrize(
    ("quantity", "ratio", "text"),
    [
        ("speed", 3.6, "in km/h"),
        ("actor_speed", 3.5, "in km/h"),
        ("pedestrian_speed", 2.237, "in miles per hour"),
        ("speed", 3.281, "in feet per second"),
        ("speed", 0.01, "in m/s, and positions in centimetres"),
        ("yaw_rate", 180 / math.pi, "in degrees per second"),
        ("yaw_rate", -1.0, "of the contrary sign"),
        ("longitudinal", 1 / 9.81, "in g"),
        ("lateral", -0.5, "of the contrary sign"),
    ],
)
def test_a_wrong_unit_is_named(quantity: str, ratio: float, text: str) -> None:
    unit = wrong_unit(quantity, ratio)
    assert unit is not None
    assert unit.text == text


@pytest.mark.parametrize(
    ("quantity", "ratio"),
    [
        *((name, 1.0) for name in ("speed", "yaw_rate", "longitudinal", "lateral", "heading", "pivot")),
        ("speed", 0.97), ("speed", 3.0), ("speed", math.nan), ("speed", 0.0), ("yaw_rate", 10.0), ("heading", -90.0),
    ],
)  # fmt: skip
def test_what_no_unit_explains_has_none(quantity: str, ratio: float) -> None:
    assert wrong_unit(quantity, ratio) is None
