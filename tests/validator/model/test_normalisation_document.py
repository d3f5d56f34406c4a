"""The normalisation document: fitted on training groups, exact as JSON, recomputed."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.mismatch import pointers
from tests.model_release import ASSIGNMENT, CANDIDATES, GROUPS, make_arrays, make_frames

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import HistoryInput
from branchdrive.driving.target import Targets
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import ModelArrays, pack_arrays
from branchdrive.model.normalisation import Training, fit_state, fit_targets, fit_trajectory, training
from branchdrive.model.normalisation_document import (
    fit_table,
    normalisation_document,
    normalisation_mismatches,
    scalings_of,
)
from branchdrive.statistics.split import split_digest

FRAMES = make_frames()
ARRAYS = make_arrays(FRAMES)
DOCUMENT = normalisation_document(ARRAYS, ASSIGNMENT)
FITTED_ON = training(GROUPS, ASSIGNMENT)


def changed(**parts: Any) -> ModelArrays:
    return replace(ARRAYS, **parts)


def test_the_document_says_on_what_it_was_fitted() -> None:
    assert DOCUMENT["split_digest"] == split_digest(ASSIGNMENT)
    assert (DOCUMENT["partition"], DOCUMENT["num_groups"]) == ("train", 3)
    sizes = {name: len(DOCUMENT[name]) for name in ("state", "past_controls", "expert", "scalars", "trajectories")}
    assert sizes == {"state": 21, "past_controls": 3, "expert": 4, "scalars": 6, "trajectories": 50}


def test_a_step_of_trajectories_is_scaled_as_with_all_others() -> None:
    rng = np.random.default_rng(0)
    paths = rng.normal(size=(37, 29, 10, 5))
    fitted_on = Training(np.ones(37, bool), "")
    whole = fit_table("trajectories", paths, fitted_on)
    for step in range(10):
        alone = fit_table("trajectories", np.ascontiguousarray(paths[:, :, step : step + 1]), fitted_on)
        assert (alone.offset == whole.offset[step]).all()
        assert (alone.scale == whole.scale[step]).all()


def test_numbers_come_back_from_json_to_the_bit() -> None:
    found = scalings_of(parse_json(dump_json(DOCUMENT)))
    state = fit_state(HistoryInput(ARRAYS.state, np.ones((5, 16), bool)), SENSOR_PROFILE, FITTED_ON)
    scalars, trajectories = fit_targets(ARRAYS.scalars, FITTED_ON), fit_trajectory(ARRAYS.trajectories, FITTED_ON)
    for one, other in ((found.state, state), (found.scalars, scalars), (found.trajectories, trajectories)):
        for field in ("offset", "scale", "limit"):
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)
        assert one.split_digest == split_digest(ASSIGNMENT)


def test_target_speed_is_standardised_and_flags_are_kept() -> None:
    scaled = scalings_of(DOCUMENT).expert.apply(ARRAYS.expert)
    np.testing.assert_array_equal(scaled[..., 1:], ARRAYS.expert[..., 1:])
    there = scaled[FITTED_ON.rows][..., 0]
    assert there.mean() == pytest.approx(0, abs=1e-12)
    assert there.std() == pytest.approx(1)


@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_what_was_normalised_comes_back(seed: int) -> None:
    arrays = make_arrays(make_frames(seed))
    scalings = scalings_of(normalisation_document(arrays, ASSIGNMENT))
    for scaling, values in (
        (scalings.state, arrays.state),
        (scalings.controls, arrays.controls),
        (scalings.expert, arrays.expert),
        (scalings.scalars, arrays.scalars.values),
        (scalings.trajectories, arrays.trajectories.values),
    ):
        np.testing.assert_allclose(scaling.invert(scaling.apply(values)), values, rtol=1e-9, atol=1e-9)


def test_the_order_of_the_groups_changes_no_bit() -> None:
    turned = pack_arrays(FRAMES, GROUPS[::-1], CANDIDATES)
    assert normalisation_document(turned, ASSIGNMENT) == DOCUMENT


def test_other_partitions_change_nothing() -> None:
    state = ARRAYS.state.copy()
    state[2:4] += 1000.0  # val and test
    assert normalisation_document(changed(state=state), ASSIGNMENT) == DOCUMENT


def test_a_target_that_no_training_group_has_is_null() -> None:
    available = ARRAYS.scalars.available.copy()
    available[FITTED_ON.rows, :, 0] = False
    scalars = Targets(np.where(available, ARRAYS.scalars.values, np.nan), available)
    document = normalisation_document(changed(scalars=scalars), ASSIGNMENT)
    assert document["scalars"][0] == {"feature": "min_ttc_s", "offset": None, "scale": None}
    assert np.isnan(scalings_of(document).scalars.offset[0])


def test_the_stored_document_has_no_mismatch() -> None:
    assert not list(normalisation_mismatches(json.loads(dump_json(DOCUMENT)), ARRAYS, ASSIGNMENT))


def test_a_fit_on_more_than_training_is_found_everywhere() -> None:
    wider = normalisation_document(ARRAYS, {**ASSIGNMENT, "g3": "train"})
    places = pointers(normalisation_mismatches(wider, ARRAYS, ASSIGNMENT))
    assert places[:2] == ["/split_digest", "/num_groups"]
    assert {place.split("/")[1] for place in places[2:]} == {
        "state", "past_controls", "expert", "scalars", "trajectories",
    }  # fmt: skip


def test_one_changed_number_is_found_with_both_values() -> None:
    document = copy.deepcopy(DOCUMENT)
    document["past_controls"][1]["scale"] *= 1.001
    (mismatch,) = normalisation_mismatches(document, ARRAYS, ASSIGNMENT)
    assert mismatch.location == {"pointer": "/past_controls/1/scale"}
    assert float(mismatch.found) == pytest.approx(1.001 * float(mismatch.expected))


def test_what_cannot_be_fitted_is_a_mismatch_of_the_whole_document() -> None:
    nobody = dict.fromkeys(ASSIGNMENT, "val")
    with pytest.raises(ValueError, match="no group is in training"):
        normalisation_document(ARRAYS, nobody)
    (mismatch,) = normalisation_mismatches(DOCUMENT, ARRAYS, nobody)
    assert (mismatch.location["pointer"], "no group is in training" in mismatch.found) == ("/", True)


def test_entries_are_found_by_their_names() -> None:
    document = {**DOCUMENT, "state": DOCUMENT["state"][::-1], "trajectories": DOCUMENT["trajectories"][::-1]}
    found, expected = scalings_of(document), scalings_of(DOCUMENT)
    np.testing.assert_array_equal(found.state.offset, expected.state.offset)
    np.testing.assert_array_equal(found.trajectories.scale, expected.trajectories.scale)


@pytest.mark.parametrize(
    ("name", "entries", "message"),
    [
        ("state", DOCUMENT["state"][1:], "`state` lacks rel_x_m; expected one entry for each of 21"),
        ("state", [*DOCUMENT["state"], DOCUMENT["state"][0]], "`state` repeats an entry or has an unknown one"),
        ("trajectories", DOCUMENT["trajectories"][:-1], "`trajectories` lacks 10, speed_mps"),
        ("expert", None, "`expert` is not a list of entries"),
        (
            "past_controls",
            [{**e, "scale": 0.0} for e in DOCUMENT["past_controls"]],
            "scales and limits must be positive",
        ),
        ("past_controls", [{**e, "scale": "1"} for e in DOCUMENT["past_controls"]], "`scale` is '1', not a number"),
        (
            "state",
            [{**e, "offset": None} for e in DOCUMENT["state"]],
            "offset and scale must not be null, except for scalars",
        ),
    ],
)
def test_a_document_that_holds_no_scalings_is_refused(name: str, entries: Any, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        scalings_of({**DOCUMENT, name: entries})
