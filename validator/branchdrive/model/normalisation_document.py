"""The document `normalisation.json`: scalings fitted on the training groups of a model layer.

It is built from packed arrays and the whole assignment of the split, whose digest it holds, by the functions of
`branchdrive.model.normalisation`. Groups are taken in sorted order, so that the order of the arrays changes
no bit. What the privileged expert computes is scaled as state is: target speed standardised, flags as they are.
What the world does not record is left as it is.
A number is written with the digits that give it back exactly; unknown and unlimited are null.

Source: paper, "Model Inputs and Targets" and "Benchmark Protocol" (training statistics only);
spec/12-model.md#normalisation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.comparison import TOLERANCE, document_mismatches
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import history_of
from branchdrive.driving.target import TARGETS, TRAJECTORY, Targets, Trajectory
from branchdrive.errors import DatasetError
from branchdrive.model.arrays import ModelArrays
from branchdrive.model.features import EXPERT_PROFILE, HISTORIES
from branchdrive.model.normalisation import (
    Scaling,
    Training,
    fit_controls,
    fit_state,
    fit_targets,
    fit_trajectory,
    training,
)
from branchdrive.statistics.split import TRAINING

__all__ = [
    "Scalings", "fit_table", "fitted_arrays", "normalisation_document", "normalisation_mismatches",
    "scalings_document", "scalings_of",
]  # fmt: skip

Array = NDArray[np.float64]

_SCALED = ("state", "past_controls", "expert")
_SCALARS = tuple(target.name for target in TARGETS)


class Scalings(NamedTuple):
    """Scalings of a model layer.

    Attributes:
        state: ``[21]``.
        controls: ``[3]``.
        expert: ``[4]``.
        scalars: ``[6]``; NaN for a target without an available training value.
        trajectories: ``[10, 5]``.
    """

    state: Scaling
    controls: Scaling
    expert: Scaling
    scalars: Scaling
    trajectories: Scaling


def normalisation_document(arrays: ModelArrays, assignment: Mapping[str, str]) -> dict[str, Any]:
    """The document of arrays and the partition of every group of the split, by group id.

    Raises:
        ValueError: A group of the arrays is in no partition, or none is in training.
    """
    order = np.argsort(np.array(arrays.groups, object), kind="stable")
    fitted_on = training([arrays.groups[i] for i in order], assignment)
    fitted = [fit_table(table, array[order], fitted_on) for table, array in fitted_arrays(arrays).items()]
    return scalings_document(Scalings(*fitted), int(fitted_on.rows.sum()))


def fitted_arrays(arrays: ModelArrays) -> dict[str, Array]:
    """What scalings are fitted on, by table in the order of `Scalings`, with NaN for what is not available."""
    targets, paths = arrays.scalars, arrays.trajectories
    return {
        "state": arrays.state,
        "past_controls": arrays.controls,
        "expert": arrays.expert,
        "scalars": np.where(targets.available, targets.values, np.nan),
        "trajectories": np.where(paths.available[..., None], paths.values, np.nan),
    }


def fit_table(table: str, values: Array, fitted_on: Training) -> Scaling:
    """Scaling of one of `fitted_arrays`, with groups in sorted order; of trajectories also of some steps alone.

    Raises:
        ValueError: A value that must be there is in no training row.
    """
    match table:
        case "state":
            return fit_state(history_of(values), SENSOR_PROFILE, fitted_on)
        case "past_controls":
            return fit_controls(history_of(values), SENSOR_PROFILE, fitted_on)
        case "expert":
            return fit_state(history_of(values), EXPERT_PROFILE, fitted_on)
        case "scalars":
            return fit_targets(Targets(values, np.isfinite(values)), fitted_on)
        case "trajectories":
            return fit_trajectory(Trajectory(values, np.asarray(np.isfinite(values).all(axis=-1))), fitted_on)
    raise KeyError(table)


def scalings_document(scalings: Scalings, num_groups: int) -> dict[str, Any]:
    """The document of scalings that were fitted on `num_groups` training groups of one split."""
    histories = {"state": scalings.state, "past_controls": scalings.controls, "expert": scalings.expert}
    scalars, trajectories = scalings.scalars, scalings.trajectories
    return {
        "split_digest": scalings.state.split_digest,
        "partition": TRAINING,
        "num_groups": num_groups,
        **{
            name: [
                {"feature": feature, "offset": offset, "scale": scale, "limit": _or_null(limit)}
                for feature, offset, scale, limit in zip(
                    _names(name),
                    scaling.offset.tolist(),
                    scaling.scale.tolist(),
                    scaling.limit.tolist(),
                    strict=True,
                )
            ]
            for name, scaling in histories.items()
        },
        "scalars": [
            {"feature": feature, "offset": _or_null(offset), "scale": _or_null(scale)}
            for feature, offset, scale in zip(_SCALARS, scalars.offset.tolist(), scalars.scale.tolist(), strict=True)
        ],
        "trajectories": [
            {
                "step": step,
                "component": component,
                "offset": float(trajectories.offset[step - 1, place]),
                "scale": float(trajectories.scale[step - 1, place]),
            }
            for step, place, component in _trajectory_places()
        ],
    }


def scalings_of(document: Mapping[str, Any]) -> Scalings:
    """The scalings that a document holds, to the bit those that it was built from.

    Raises:
        DatasetError: An entry is missing, repeated, unknown, or no scaling.
    """
    digest = str(document.get("split_digest"))

    def scaling(name: str, wanted: Sequence[tuple[Any, ...]], fields: tuple[str, ...]) -> Scaling:
        entries = _by_key(document, name, wanted, fields)
        rows = [entries[key] for key in wanted]
        offset = np.array([_number(row, "offset", name, math.nan) for row in rows])
        scale = np.array([_number(row, "scale", name, math.nan) for row in rows])
        limit = np.array([_number(row, "limit", name, math.inf) for row in rows])
        if (scale <= 0).any() or (limit <= 0).any():
            raise DatasetError(
                f"`normalisation.json`: `{name}`: scales and limits must be positive; run `branchdrive-validate`"
            )
        is_known = np.isfinite(offset) & np.isfinite(scale)
        if name != "scalars" and not is_known.all():
            raise DatasetError(f"`normalisation.json`: `{name}`: offset and scale must not be null, except for scalars")
        return Scaling(np.where(is_known, offset, np.nan), np.where(is_known, scale, np.nan), limit, digest)

    state, controls, expert = (
        scaling(name, [(feature,) for feature in _names(name)], ("feature",)) for name in _SCALED
    )
    scalars = scaling("scalars", [(name,) for name in _SCALARS], ("feature",))
    places = [(step, component) for step, _, component in _trajectory_places()]
    flat = scaling("trajectories", places, ("step", "component"))
    shape = (FUTURE_OBSERVATIONS, len(TRAJECTORY))
    offset, scale, limit = (part.reshape(shape) for part in (flat.offset, flat.scale, flat.limit))
    return Scalings(state, controls, expert, scalars, Scaling(offset, scale, limit, digest))


def normalisation_mismatches(
    document: Mapping[str, Any], arrays: ModelArrays, assignment: Mapping[str, str]
) -> Iterator[Mismatch]:
    """Where `document` is not the one that follows from the arrays and the split, numbers within `TOLERANCE`."""
    try:
        expected = normalisation_document(arrays, assignment)
    except ValueError as error:
        yield Mismatch({"pointer": "/"}, "a scaling fitted on training groups", str(error))
        return
    yield from document_mismatches(expected, document, tolerance=TOLERANCE)


def _names(table: str) -> tuple[str, ...]:
    return tuple(feature.name for feature in HISTORIES[table].features)


def _trajectory_places() -> list[tuple[int, int, str]]:
    """Step, place of the component and its name, step by step."""
    return [
        (step, place, component)
        for step in range(1, FUTURE_OBSERVATIONS + 1)
        for place, component in enumerate(TRAJECTORY)
    ]


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _by_key(
    document: Mapping[str, Any], name: str, wanted: Sequence[tuple[Any, ...]], fields: tuple[str, ...]
) -> dict[tuple[Any, ...], Mapping[str, Any]]:
    """Entries of a list by the values of `fields`, exactly one for each wanted key."""
    entries = document.get(name)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise DatasetError(f"`normalisation.json`: `{name}` is not a list of entries; run `branchdrive-validate`")
    keys = [tuple(entry.get(field) for field in fields) for entry in entries]
    found = {repr(key) for key in keys}
    if len(keys) != len(wanted) or found != {repr(key) for key in wanted}:
        lacking = [key for key in wanted if repr(key) not in found]
        missing = f"lacks {', '.join(map(str, lacking[0]))}" if lacking else "repeats an entry or has an unknown one"
        raise DatasetError(f"`normalisation.json`: `{name}` {missing}; expected one entry for each of {len(wanted)}")
    return dict(zip(keys, entries, strict=True))


def _number(entry: Mapping[str, Any], field: str, name: str, unknown: float) -> float:
    value = entry.get(field)
    if value is None:
        return unknown
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DatasetError(f"`normalisation.json`: `{name}`: `{field}` is {str(value)[:40]!r}, not a number")
    return float(value)
