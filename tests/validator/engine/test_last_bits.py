"""Last bits of what follows from the raw layer decide no rule on a release.

Another processor computes whatever follows by arithmetic with other last bits: a relative noise of up to eight units
in the last place stands for it here, once in what the validator computes from the raw layer and once in what the
builder wrote. Recorded and counted numbers are compared to the bit and stay as they are, and so do the inputs of the
leakage audit, whose arithmetic the specification states to the bit.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from tests.validator.engine.release_view import release_view
from tests.validator.engine.rules.release import release_draft

from branchdrive.contract.layer import LAYERS
from branchdrive.contract.rule import rules_of
from branchdrive.engine.derived_rules import judge_layers
from branchdrive.layers.view import RawLayer, ReleaseView
from branchdrive.tables.frame import Frame, Values

CALCULATED = {
    "pairs": (
        "position_m", "heading_deg", "speed_mps", "steer", "throttle", "brake", "vehicle_gap_m",
        "vehicle_rel_speed_mps", "pedestrian_gap_m",
    ),
    "state": (
        "rel_x_m", "rel_y_m", "rel_sin_yaw", "rel_cos_yaw", "mean_yaw_rate_radps", "mean_accel_longitudinal_mps2",
        "mean_accel_lateral_mps2",
    ),
    "candidates": ("offset_x_m", "offset_y_m", "offset_yaw_rad"),
    "scalars": ("displacement_m", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"),
    "trajectories": ("x_m", "y_m", "sin_yaw", "cos_yaw"),
}  # fmt: skip
"""Columns that arithmetic gives, by table."""

MODEL = LAYERS["model"].tables
"""Tables whose stored numbers are packed, summarised and compared further; of `pairs` thresholds are exact copies."""


def perturbed(values: Values, rng: np.random.Generator) -> Values:
    noise = 1.0 + rng.integers(-8, 9, values.shape) * np.finfo(np.float64).eps
    return values * noise


def with_noise(frames: Mapping[str, Frame], tables: tuple[str, ...], rng: np.random.Generator) -> dict[str, Frame]:
    return {
        table: {
            name: perturbed(values, rng) if table in tables and name in CALCULATED.get(table, ()) else values
            for name, values in frame.items()
        }
        for table, frame in frames.items()
    }


class OtherBits(ReleaseView):
    """A release as another machine would have computed and as another one would have written it."""

    def __init__(self, source: ReleaseView, rng: np.random.Generator) -> None:
        rows = source.raw_rows
        points = rows["routes"]["points"]
        frames = with_noise(rows, tuple(rows), rng)
        frames["routes"] = {
            **rows["routes"], "points": points + rng.integers(-8, 9, points.shape) * np.spacing(points)
        }  # fmt: skip
        super().__init__(
            source.descriptor, source.tables, source.documents, source.contents,
            RawLayer(frames, digest=source.raw.digest,
                     descriptor=source.raw.descriptor),
            source.files, source.mismatches, digests=source.digests, sizes=source.sizes,
            num_rows=source.num_rows,
        )  # fmt: skip
        stored = {table: source.rows(table) for table in source.tables}
        self._frames = {table: dict(frame) for table, frame in with_noise(stored, MODEL, rng).items()}


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> ReleaseView:
    """A valid release with its raw layer, as rules see it."""
    return release_view(release_draft().write(tmp_path_factory.mktemp("release") / "dataset"))


def test_every_column_that_is_calculated_is_perturbed(seen: ReleaseView) -> None:
    for table, columns in CALCULATED.items():
        assert set(columns) <= set(seen.rows(table)), table
    rng = np.random.default_rng(0)
    other = OtherBits(seen, rng)
    for table, columns in CALCULATED.items():
        for name in columns:
            before, after = seen.expected(table)[name], other.expected(table)[name]
            assert not np.any(before) or np.any(before != after), (table, name)


@pytest.mark.parametrize("seed", range(2))
def test_last_bits_turn_no_rule_around(seen: ReleaseView, seed: int) -> None:
    view, statuses = OtherBits(seen, np.random.default_rng(seed)), {}
    for rule_id, tally in judge_layers(view, rules_of("layers", "layer_rows"))[0].items():
        assert not tally.findings, [finding.message for finding in tally.findings[:3]]
        assert not tally.errors
        statuses[rule_id] = tally.status
    assert sum(status == "pass" for status in statuses.values()) > 70, statuses
