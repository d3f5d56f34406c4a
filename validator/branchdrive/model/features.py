"""Features of the model layer: what each history holds, which contract reads it, and the document that says so.

Histories are read under an input contract, which names the tables that it reads::

    sensor      state, past_controls
    mixed       and expert
    privileged  and surroundings
    objects     state, past_controls, and the table `objects` where a release has it, which is no history

The document `features.json` is a pure function of the dataset's descriptor: nothing in it depends on data.

Source: paper, "Model Inputs and Targets" and "Release Structure"; spec/12-model.md#features,
spec/12-model.md#contracts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import LAYER_TABLES, STREAMS, TABLES, Column
from branchdrive.contract.comparison import document_mismatches
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.timing import FUTURE_OBSERVATIONS, HISTORY_OFFSETS
from branchdrive.driving.feature import MIXED_PROFILE, SENSOR_PROFILE, Feature, InputContract, InputProfile
from branchdrive.driving.history import CONTROL_WINDOW
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.errors import UsageError

__all__ = [
    "CONTRACT_TABLES", "EXPERT_PROFILE", "HISTORIES", "OBJECT_FEATURES", "History", "admit_column", "contract_tables",
    "feature_mismatches", "features_document", "recorded_features", "target_mask",
]  # fmt: skip


class History(NamedTuple):
    """One table of histories.

    Attributes:
        contract: The freest contract that reads it.
        offsets: Ticks of its rows relative to the branch tick, in order.
        features: Its features, in order.
    """

    contract: InputContract
    offsets: tuple[int, ...]
    features: tuple[Feature, ...]


EXPERT_PROFILE = InputProfile("expert", InputContract.MIXED, MIXED_PROFILE.state[len(SENSOR_PROFILE.state) :])
"""What the privileged expert adds to the sensor profile: target speed and three hazard flags."""


def _surroundings() -> Iterator[Feature]:
    """Evidence columns in their units; a categorical column becomes one feature for each category."""
    table = LAYER_TABLES["surroundings"]
    masks = {column.available.mask for column in table.columns if column.available}
    for column in table.value_columns:
        if column.name in masks:
            continue
        categories = TABLES["evidence"][column.name].values
        for category in categories:
            text = f"{column.description.rstrip('.')}: {category}."
            yield Feature(f"{column.name}_{category}", "evidence", (column.name,), text, normalised=False)
        if not categories:
            yield Feature(
                column.name, "evidence", (column.name,), column.description, column.unit, column.frame, normalised=False
            )


HISTORIES: Mapping[str, History] = MappingProxyType(
    {
        "state": History(InputContract.SENSOR, HISTORY_OFFSETS, SENSOR_PROFILE.state),
        "past_controls": History(InputContract.SENSOR, CONTROL_WINDOW, SENSOR_PROFILE.controls),
        "expert": History(InputContract.MIXED, HISTORY_OFFSETS, EXPERT_PROFILE.state),
        "surroundings": History(InputContract.PRIVILEGED, HISTORY_OFFSETS, tuple(_surroundings())),
    }
)
"""Tables of histories, in the order of their contracts."""

CONTRACT_TABLES: Mapping[InputContract, tuple[str, ...]] = MappingProxyType(
    {
        contract: tuple(name for name, history in HISTORIES.items() if history.contract.value in contract.tracks)
        for contract in InputContract
    }
)
"""Tables of histories that each contract reads."""


OBJECT_FEATURES: tuple[tuple[str, str], ...] = tuple(
    (column.name if value is None else f"{column.name}_{value}", column.name)
    for column in LAYER_TABLES["objects"].value_columns
    for value in column.values or (None,)
)
"""Names of the features of an object with the columns that they are, in order; a category is a feature, 1 or 0."""


def contract_tables(contract: InputContract, descriptor: Descriptor) -> tuple[str, ...]:
    """Tables of histories that the contract reads in a dataset, which may claim no stream of evidence."""
    return tuple(name for name in CONTRACT_TABLES[contract] if name != "surroundings" or _has_evidence(descriptor))


def recorded_features(table: str, descriptor: Descriptor) -> NDArray[np.bool_]:
    """Which features of a table of histories the dataset records ``[features]``."""
    unrecorded = set(descriptor.unrecorded)
    return np.array([not feature.sources & unrecorded for feature in HISTORIES[table].features], np.bool_)


def admit_column(contract: InputContract, table: str, column: str) -> Column:
    """The declaration of a column of the model layer that inputs under the contract may hold.

    Raises:
        UsageError: No such column, or its track is not admitted; identifiers and outcomes never are.
    """
    if table not in LAYERS["model"].tables:
        raise UsageError(f"no table {table!r} in the model layer, which has {list(LAYERS['model'].tables)}")
    try:
        declared = LAYER_TABLES[table][column]
    except KeyError:
        names = [declared.name for declared in LAYER_TABLES[table].columns]
        raise UsageError(f"no column {column!r} in the table `{table}`, which has {names}") from None
    if declared.track not in contract.tracks:
        raise UsageError(
            f"column `{table}.{column}` is of track {declared.track!r} and the input contract {contract.value!r} "
            f"admits {', '.join(contract.tracks)}; choose another contract or another column"
        )
    return declared


_DESCRIBED = tuple(contract for contract in InputContract if contract is not InputContract.OBJECTS)
"""Contracts of the document `features.json`, which says the same of a release with objects and of one without."""


def target_mask(name: str) -> str:
    """Column with the availability of the scalar target `name`.

    >>> target_mask("min_ttc_s")
    'min_ttc_available'
    """
    declared = LAYER_TABLES["scalars"][name].available
    if declared is None or declared.mask is None:
        raise UsageError(f"column `scalars.{name}` has no mask; scalar targets are {[t.name for t in TARGETS]}")
    return declared.mask


def features_document(descriptor: Descriptor) -> dict[str, Any]:
    """The document `features.json` of a dataset.

    A history that no claimed stream fills is left out of contracts, histories and arrays; so are the encoded
    actions of a bank without an encoding. In a shape, ``"groups"`` is the number of groups.
    """
    contracts = {contract.value: list(contract_tables(contract, descriptor)) for contract in _DESCRIBED}
    encoding = descriptor.action_encoding
    return {
        "contracts": contracts,
        "histories": {
            name: {
                "rows": len(HISTORIES[name].offsets),
                "features": [
                    {**feature.record, "recorded": bool(is_recorded)}
                    for feature, is_recorded in zip(
                        HISTORIES[name].features, recorded_features(name, descriptor), strict=True
                    )
                ],
            }
            for name in contracts[InputContract.PRIVILEGED.value]
        },
        "candidate_order": list(descriptor.action_bank.keys),
        "encoding": None if encoding is None else encoding.model_dump(mode="json"),
        "targets": [
            {"name": target.name, "mask": target_mask(target.name), "symbol": target.symbol, "unit": target.unit}
            for target in TARGETS
        ],
        "trajectory": {"steps": FUTURE_OBSERVATIONS, "components": list(TRAJECTORY)},
        "arrays": dict(_arrays(descriptor)),
    }


def feature_mismatches(document: Any, descriptor: Descriptor) -> Iterator[Mismatch]:
    """Where `document` is not the `features_document` of a descriptor."""
    return document_mismatches(features_document(descriptor), document)


def _has_evidence(descriptor: Descriptor) -> bool:
    return any("evidence" in STREAMS[stream].tables for stream in descriptor.streams)


def _arrays(descriptor: Descriptor) -> Iterator[tuple[str, dict[str, Any]]]:
    num_candidates = len(descriptor.action_bank.keys)
    for table in contract_tables(InputContract.PRIVILEGED, descriptor):
        history = HISTORIES[table]
        shape = ["groups", len(history.offsets), len(history.features)]
        name = "controls" if table == "past_controls" else table
        yield name, {"shape": shape, "tables": [table]}
        if table == "surroundings":
            yield f"{name}_available", {"shape": shape, "tables": [table]}
    if descriptor.action_encoding is not None:
        yield "actions", {"shape": [num_candidates, descriptor.action_encoding.width], "tables": ["actions"]}
    for name in ("scalars", "scalars_available"):
        yield name, {"shape": ["groups", num_candidates, len(TARGETS)], "tables": ["scalars"]}
    steps = [FUTURE_OBSERVATIONS, len(TRAJECTORY)]
    yield "trajectories", {"shape": ["groups", num_candidates, *steps], "tables": ["trajectories"]}
