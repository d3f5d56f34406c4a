"""Predictions of a benchmark: a round trip through tables, and everything that a table may lack or have too much."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.validator.benchmark.samples import data, group_ids, prediction_set, rows_of, small_protocol

from branchdrive.benchmark.prediction.check import prediction_mismatches
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.prediction.rows import TABLES
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.errors import DatasetError
from branchdrive.tables.frame import concat, take


def frames() -> dict[str, dict[str, Any]]:
    return {name: dict(frame) for name, frame in prediction_set().to_frames(data()).items()}


def texts(found: dict[str, dict[str, Any]], *, held: bool = True) -> list[tuple[str, str]]:
    """What is found in which table."""
    protocol = small_protocol() if held else None
    return [(str(m.location["table"]), m.found) for m in prediction_mismatches(rows_of(found), protocol)]


def without(frame: dict[str, Any], rows: Any) -> dict[str, Any]:
    return take(frame, np.setdiff1d(np.arange(len(frame["model"])), rows))


def test_tables_have_the_declared_columns() -> None:
    for name, frame in frames().items():
        assert list(frame) == [column.name for column in LAYER_TABLES[name].columns]


def test_predictions_come_back_from_their_tables_whatever_the_order_of_rows() -> None:
    shuffled = {
        name: take(frame, np.random.default_rng(4).permutation(len(frame["model"]))) for name, frame in frames().items()
    }
    found = PredictionSet.of_rows(rows_of(shuffled))
    assert found.models == ("M0", "M1", "M2", "M3")
    assert found.seeds("M3") == (11, 23, 37)
    for partition in ("val", "calibration", "test"):
        assert found.scalars("M3", partition).tobytes() == prediction_set().scalars("M3", partition).tobytes()
    assert found.digest(data()) == prediction_set().digest(data())
    assert texts(shuffled) == []


def test_outcomes_of_partitions_are_slices_of_one_array() -> None:
    bases = {id(part.outcomes.paths.base) for part in data().parts.values()}
    assert len(data().parts) > 1 and len(bases) == 1 and bases != {id(None)}


def test_rows_of_some_groups_are_those_of_all_that_are_theirs() -> None:
    wanted = {*group_ids("test")[:2], group_ids("val")[0]}
    for name, frame in frames().items():
        own = take(frame, np.array([group in wanted for group in frame["group_id"].tolist()], bool))
        found = [*prediction_set().frames(name, data(), wanted)]
        assert len(found) == sum(len(prediction_set().seeds(model)) for model in prediction_set().models)
        for column, values in concat(found).items():
            np.testing.assert_array_equal(values, own[column])


def test_digest_changes_with_any_number() -> None:
    changed = frames()
    changed["predicted_trajectories"]["speed_mps"][77] += 1e-12
    assert PredictionSet.of_rows(rows_of(changed)).digest(data()) != prediction_set().digest(data())


def row(model: str = "M3", seed: int = 23, group: str = "test-004", action: str = "brake_0.50") -> int:
    frame = frames()["predictions"]
    (found,) = np.flatnonzero(
        (frame["model"] == model)
        & (frame["seed"] == seed)
        & (frame["group_id"] == group)
        & (frame["action_key"] == action)
    )
    return int(found)


def test_missing_candidate_is_found() -> None:
    broken = frames()
    broken["predictions"] = without(broken["predictions"], [row()])
    (mismatch,) = prediction_mismatches(rows_of(broken), small_protocol())
    assert mismatch.found == "no row"
    assert mismatch.location == {
        "table": "predictions",
        "model": "M3",
        "seed": 23,
        "group_id": "test-004",
        "action_key": "brake_0.50",
    }
    with pytest.raises(DatasetError, match=r"'brake_0\.50': expected one row of this candidate, found no row"):
        PredictionSet.of_rows(rows_of(broken))


def test_missing_step_is_found() -> None:
    broken = frames()
    broken["predicted_trajectories"] = without(broken["predicted_trajectories"], [10 * row() + 3])
    (mismatch,) = prediction_mismatches(rows_of(broken), small_protocol())
    assert (mismatch.found, mismatch.location["step"]) == ("no row", 4)


def test_repeated_candidate_is_found() -> None:
    broken = frames()
    broken["predictions"] = concat([broken["predictions"], take(broken["predictions"], np.array([row()]))])
    assert texts(broken) == [("predictions", "several rows")]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e13])
def test_value_that_is_no_number_is_found(value: float) -> None:
    broken = frames()
    broken["predictions"]["min_separation_m"][row()] = value
    assert texts(broken) == [("predictions", str(value))]
    with pytest.raises(DatasetError, match="a finite `min_separation_m`"):
        PredictionSet.of_rows(rows_of(broken))


def test_group_and_candidate_of_another_release_are_found() -> None:
    broken = frames()
    broken["predictions"]["group_id"][row()] = "elsewhere"
    assert texts(broken) == [("predictions", "none of its groups"), ("predictions", "no row")]
    broken = frames()
    broken["predictions"]["action_key"][row()] = "somersault"
    assert texts(broken) == [("predictions", "neither"), ("predictions", "no row")]


def test_training_groups_are_not_predicted() -> None:
    broken = frames()
    for name in TABLES:
        extra = take(broken[name], broken[name]["group_id"] == "test-000")
        extra["group_id"] = np.full(len(extra["model"]), group_ids("train")[0], object)
        broken[name] = concat([broken[name], extra])
    assert set(texts(broken)) == {(name, "one of 'train'") for name in TABLES}
    assert set(texts(broken, held=False)) == {(name, "no row") for name in TABLES}


def test_incomplete_seeds_are_found() -> None:
    broken = {
        name: take(frame, ~((frame["model"] == "M2") & (frame["seed"] == 37))) for name, frame in frames().items()
    }
    (mismatch,) = prediction_mismatches(rows_of(broken), small_protocol())
    assert mismatch.location == {"table": "predictions", "model": "M2"}
    assert (mismatch.expected, mismatch.found) == ("seeds [11, 23, 37]", "seeds [11, 23]")


def test_declared_model_must_predict_every_partition_and_another_the_reported_one() -> None:
    whole = frames()
    is_test = {name: np.char.startswith(frame["group_id"].astype(str), "test") for name, frame in whole.items()}
    cut = {name: take(frame, is_test[name] | (frame["model"] != "M1")) for name, frame in whole.items()}
    places = {str(m.location["group_id"]).split("-")[0] for m in prediction_mismatches(rows_of(cut), small_protocol())}
    assert places == {"val", "calibration"}
    foreign = {}
    for name, frame in whole.items():
        own = take(frame, is_test[name] & (frame["model"] == "M1") & (frame["seed"] == 11))
        foreign[name] = concat([frame, own | {"model": np.full(len(own["model"]), "theirs", object)}])
    assert texts(foreign) == []
    found = PredictionSet.of_rows(rows_of(foreign))
    assert found.covers("theirs", "test")
    assert not found.covers("theirs", "val")
    assert not found.covers("nobody", "test")


def test_more_models_than_anybody_judges_are_refused() -> None:
    many = frames()
    many["predictions"]["seed"] = np.arange(len(many["predictions"]["seed"]))
    ((table, found),) = texts(many)
    assert (table, found.endswith(" pairs")) == ("predictions", True)
    with pytest.raises(DatasetError, match="at most 256 pairs"):
        PredictionSet.of_rows(rows_of(many))


def test_names_of_joined_models_differ() -> None:
    with pytest.raises(DatasetError, match="predictions of a model 'M0' already"):
        prediction_set().joined(prediction_set())


def test_more_models_than_the_draws_of_a_protocol_leave_room_for_are_refused() -> None:
    protocol = small_protocol()
    drawn = protocol.model_copy(update={"statistics": protocol.statistics.model_copy(update={"resamples": 5000})})
    many = frames()
    many["predictions"]["seed"] = np.arange(len(many["predictions"]["seed"])) % 50
    (mismatch,) = prediction_mismatches(rows_of(many), drawn)
    assert mismatch.location == {"table": "predictions"}
    assert mismatch.found.endswith("resamples together; the limit is 524288")
