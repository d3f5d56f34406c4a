"""Changes of a raw log that must not change an input of the model layer: what follows the branch, names, replays.

Source: spec/13-leakage.md#metamorphic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests import synthetic
from tests.validator.engine import metamorphic_steps
from tests.validator.engine.datasets import FOLDER
from tests.validator.engine.metamorphic_steps import STEPS, changed_groups

from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.examine import examine
from branchdrive.model.inputs import inputs_of
from branchdrive.raw.shard_view import ShardView

Inputs = Callable[[ShardView, Any], Any]


def changed() -> dict[str, tuple[str, ...]]:
    view = ShardView(synthetic.base_tables()[FOLDER], Descriptor.model_validate(synthetic.descriptor()))
    selection = examine(view)[1].selection
    assert (selection.chosen >= 0).all()
    return changed_groups(view, selection.nominal, selection.chosen)


def test_no_step_changes_an_input() -> None:
    assert changed() == dict.fromkeys(STEPS, ())


def _heading_of_another(view: ShardView, nominals: Any, attempts: Any, offset: int) -> Any:
    """The inputs, with the heading that other attempts have at an offset from the branch for the speed."""
    inputs = {name: dict(frame) for name, frame in inputs_of(view, nominals).items()}
    rows = view.observations.find(attempts, view.branch_tick[attempts] + offset)
    heading = np.where(rows >= 0, view.observations["yaw_rad"][rows], 0.0).astype(np.float64)
    speeds = inputs["state"]["speed_mps"]
    inputs["state"]["speed_mps"] = np.repeat(heading, len(speeds) // len(nominals)).astype(speeds.dtype)
    return inputs


def _looks_ahead(view: ShardView, nominals: Any) -> Any:
    return _heading_of_another(view, nominals, nominals, 5)


def _first_by_name(view: ShardView, nominals: Any) -> Any:
    """Inputs that depend on which attempt of the group has the first name."""
    ids = np.array(view.rollout_ids, object)
    inputs = {name: dict(frame) for name, frame in inputs_of(view, nominals).items()}
    first = np.array([np.argsort(ids[view.group == view.group[n]])[0] for n in nominals])
    speeds = inputs["state"]["speed_mps"]
    inputs["state"]["speed_mps"] = np.repeat(first, len(speeds) // len(nominals)).astype(speeds.dtype)
    return inputs


@pytest.mark.parametrize(
    ("inputs", "steps"),
    [(_looks_ahead, {"truncation", "future_swap"}), (_first_by_name, {"renaming"})],
    ids=["inputs that look ahead", "inputs that hang on names"],
)
def test_a_step_finds_inputs_that_hang_on_what_it_changes(
    inputs: Inputs, steps: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metamorphic_steps, "inputs_of", inputs)
    found = changed()
    assert {step for step, groups in found.items() if groups} >= steps
