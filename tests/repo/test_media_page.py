"""The page on images shows what works."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.repo.checkout import ROOT
from tests.validator.writer.invented import (
    BRANCH_TICK,
    WHOLE_TICKS,
    branch_fields,
    fill,
    identity_fields,
    image_of,
    make_descriptor,
    result_fields,
)

import branchdrive as bd
from branchdrive.contract.columns import STREAMS
from branchdrive.contract.timing import WINDOW_OFFSETS

PAGE = (ROOT / "docs" / "media.md").read_text(encoding="utf-8")
CAMERAS = tuple(
    bd.PinholeCamera(
        name=name, stream="rgb_surround", width_px=5, height_px=4, fx_px=3.0, fy_px=3.0, cx_px=2.5, cy_px=2.0,
        x_m=0.0, y_m=0.0, z_m=1.5, yaw_rad=0.0, pitch_rad=0.0,
    )
    for name in STREAMS["rgb_surround"].cameras
)  # fmt: skip


def test_the_examples_run_one_after_the_other(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    plain = make_descriptor(has_evidence=False)
    described = plain.model_copy(update={"streams": (*plain.streams, "rgb_surround"), "cameras": CAMERAS})
    with bd.DatasetWriter(tmp_path / "dataset", described) as writer:
        with writer.begin_group("g00000-anything") as group:
            rollout = group.begin_rollout(**identity_fields("nominal", "nominal", None))
            for tick in (BRANCH_TICK + offset for offset in WINDOW_OFFSETS):
                for camera in CAMERAS:
                    rollout.append_frame(tick, camera.name, image_of(camera, tick))
            fill(rollout, (), num_ticks=WHOLE_TICKS, is_active=False, has_evidence=False)
            rollout.finish(**result_fields(), **branch_fields(rollout.rollout_id))
        writer.finalize()
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(block.replace("build/with-media", str(tmp_path / "dataset")), names)
    assert names["history"].shape == (16, 4, 5, 3)
    assert len(names["window"]) == 26
    assert tuple(names["batch"]["frames"].shape) == (1, 16, 6, 4, 5, 3)
