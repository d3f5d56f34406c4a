"""Features of the model inputs as data, and the contracts that say which columns an input may use.

A feature names the recorded columns it is computed from; its track is the most restricted track among
them, read from `columns.json` and never declared a second time. An input contract admits tracks::

    sensor      sensor columns
    objects     and what sensors tell of others, in the model layer alone
    mixed       sensor columns, and what the privileged expert computes (target speed, hazard flags)
    privileged  mixed ones, and privileged evidence (actors, separation, lights)

No contract admits debug, audit or evaluation columns. The one exception is the controls that reached the
vehicle, audit columns that every contract admits: a history holds them before ``t_b`` and nowhere else.
A profile cannot be built around a column that its contract refuses.

Source: paper, "Recorded Modalities" and "Model Inputs and Targets" (21 state variables, sensor-oriented inputs);
spec/05-raw-streams.md. Which variables they are is this project's choice.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from branchdrive.contract.columns import STREAMS, TABLES, Column, Stream
from branchdrive.errors import UsageError

__all__ = ["MIXED_PROFILE", "SENSOR_PROFILE", "Feature", "InputContract", "InputProfile"]

_TRACKS = ("sensor", "objects", "mixed", "privileged", "debug", "audit", "evaluation")
"""Tracks from the freest to the most restricted."""

_ADMITTED = {
    "sensor": ("sensor",),
    "objects": ("sensor", "objects"),
    "mixed": ("sensor", "mixed"),
    "privileged": ("sensor", "mixed", "privileged"),
}
"""Tracks that each contract admits; what sensors tell of others is never mixed with what they do not."""

_APPLIED = ("applied_steer", "applied_throttle", "applied_brake")


def _declared(table: str, column: str) -> Column:
    try:
        return TABLES[table][column]
    except KeyError:
        raise UsageError(f"no column `{table}.{column}` is declared in columns.json") from None


class InputContract(Enum):
    """What an input may be computed from; its value names the most restricted track that it admits."""

    SENSOR = "sensor"
    OBJECTS = "objects"
    MIXED = "mixed"
    PRIVILEGED = "privileged"

    @property
    def tracks(self) -> tuple[str, ...]:
        """Tracks that the contract admits."""
        return _ADMITTED[self.value]

    @classmethod
    def named(cls, contract: InputContract | str) -> InputContract:
        """The contract that is given itself, or by its name.

        Raises:
            UsageError: No contract is called so.
        """
        try:
            return cls(contract)
        except ValueError:
            raise UsageError(f"no input contract {contract!r}; there are {', '.join(c.value for c in cls)}") from None

    def admit(self, table: str, column: str) -> Column:
        """The declaration of a column that the contract admits.

        Raises:
            UsageError: The column is not declared, or its track is not admitted.
        """
        declared = _declared(table, column)
        if declared.track not in self.tracks and not (table == "controls" and column in _APPLIED):
            admitted = ", ".join(self.tracks)
            raise UsageError(
                f"column `{table}.{column}` is of track {declared.track!r} and the input contract {self.value!r} "
                f"admits {admitted}; take it out of the profile or choose another contract"
            )
        return declared

    def admit_stream(self, name: str) -> Stream:
        """The declaration of a stream of images that the contract admits.

        Raises:
            UsageError: There is no such stream, or its track is not admitted.
        """
        declared = STREAMS.get(name)
        if declared is None or not declared.cameras:
            there = ", ".join(stream.name for stream in STREAMS.values() if stream.cameras)
            raise UsageError(f"no stream of images {name!r}; there are {there}")
        if declared.track not in self.tracks:
            admitted = ", ".join(self.tracks)
            raise UsageError(
                f"stream `{name}` is of track {declared.track!r} and the input contract {self.value!r} admits "
                f"{admitted}; leave the images out or choose another contract"
            )
        return declared


@dataclass(frozen=True)
class Feature:
    """One feature of an input.

    Attributes:
        name: Name with unit suffix, unique in its profile.
        table: Table that it is computed from.
        columns: Columns of that table that it is computed from.
        description: What it is, one sentence.
        unit: Unit, ``None`` where there is none.
        frame: ``branch``: of the ego's own pose at ``t_b``; ``ego``: of its pose at the row.
        normalised: Whether models see it standardised; flags and one-hots are left as they are.
    """

    name: str
    table: str
    columns: tuple[str, ...]
    description: str
    unit: str | None = None
    frame: str | None = None
    normalised: bool = True

    @property
    def track(self) -> str:
        """The most restricted track among the columns."""
        return max((_declared(self.table, column).track for column in self.columns), key=_TRACKS.index)

    @property
    def sources(self) -> frozenset[str]:
        """The columns, as ``table.column``."""
        return frozenset(f"{self.table}.{column}" for column in self.columns)

    @property
    def record(self) -> dict[str, Any]:
        """The feature as JSON data: name, unit, frame, track, source columns, normalised, description."""
        return {
            "name": self.name,
            "unit": self.unit,
            "frame": self.frame,
            "track": self.track,
            "columns": [f"{self.table}.{column}" for column in self.columns],
            "normalised": self.normalised,
            "description": self.description,
        }


def _recorded(*columns: str, normalised: bool = True) -> tuple[Feature, ...]:
    """Observation columns as they were recorded: name, unit and frame are the columns' own."""
    table = TABLES["observations"]
    return tuple(
        Feature(name, table.name, (name,), table[name].description, table[name].unit, table[name].frame, normalised)
        for name in columns
    )


def _derived(name: str, columns: str, description: str, unit: str | None = None, frame: str | None = None) -> Feature:
    return Feature(name, "observations", tuple(columns.split()), description, unit, frame)


_STATE = (
    _derived("rel_x_m", "x_m y_m yaw_rad", "Ego centre, x, relative to the pose at the branch.", "m", "branch"),
    _derived("rel_y_m", "x_m y_m yaw_rad", "Ego centre, y, relative to the pose at the branch.", "m", "branch"),
    _derived("rel_sin_yaw", "yaw_rad", "Sine of the heading relative to the heading at the branch.", None, "branch"),
    _derived("rel_cos_yaw", "yaw_rad", "Cosine of the heading relative to the heading at the branch.", None, "branch"),
    *_recorded("speed_mps"),
    _derived("mean_accel_longitudinal_mps2", "speed_mps yaw_rad", "Acceleration along the mean heading.", "m/s2"),
    _derived("mean_accel_lateral_mps2", "speed_mps yaw_rad", "Acceleration to the left of the mean heading.", "m/s2"),
    _derived("mean_yaw_rate_radps", "yaw_rad", "Yaw rate since the previous observation.", "rad/s"),
    *_recorded("speed_limit_mps", "route_offset_m", "route_heading_error_rad"),
    *_recorded("target_point_1_x_m", "target_point_1_y_m", "target_point_2_x_m", "target_point_2_y_m"),
    *(
        Feature(f"command_{value}", "observations", ("command",), f"Navigation command is {value}.", normalised=False)
        for value in TABLES["observations"]["command"].values
    ),
)
_EXPERT = (
    *_recorded("target_speed_mps"),
    *_recorded("vehicle_hazard", "pedestrian_hazard", "traffic_light_hazard", normalised=False),
)
_CONTROLS = tuple(
    Feature(name.removeprefix("applied_"), "controls", (name,), TABLES["controls"][name].description)
    for name in _APPLIED
)


@dataclass(frozen=True)
class InputProfile:
    """Features of the state and control histories, in order, under one input contract.

    Raises:
        UsageError: A feature uses a column that the contract refuses or its history does not hold, or
            two features have one name.
    """

    name: str
    contract: InputContract
    state: tuple[Feature, ...]
    controls: tuple[Feature, ...] = _CONTROLS

    def __post_init__(self) -> None:
        for table, features in (("observations", self.state), ("controls", self.controls)):
            if len({feature.name for feature in features}) < len(features):
                raise UsageError(f"profile {self.name!r}: two features of `{table}` have one name")
            for feature in features:
                if feature.table != table or not feature.columns:
                    found = f"columns {list(feature.columns)} of `{feature.table}`"
                    raise UsageError(f"feature `{feature.name}` has {found}, expected columns of `{table}`")
                for column in feature.columns:
                    self.contract.admit(table, column)
        if any(len(feature.columns) != 1 for feature in self.controls):
            raise UsageError(f"profile {self.name!r}: a control is one column that reached the vehicle")

    def without(self, unrecorded: Collection[str]) -> InputProfile:
        """This profile without the state variables that need a column, as ``table.column``, that is not recorded."""
        kept = tuple(feature for feature in self.state if not feature.sources & set(unrecorded))
        return replace(self, state=kept)

    @property
    def state_columns(self) -> tuple[str, ...]:
        """Columns of `observations` that the state history is computed from, each once."""
        return tuple(dict.fromkeys(column for feature in self.state for column in feature.columns))

    @property
    def control_columns(self) -> tuple[str, ...]:
        """Columns of `controls` that the control history is computed from, each once."""
        return tuple(dict.fromkeys(column for feature in self.controls for column in feature.columns))


SENSOR_PROFILE = InputProfile("sensor", InputContract.SENSOR, _STATE)
"""The 21 state variables and three controls that the ego vehicle can know on the road."""

MIXED_PROFILE = InputProfile("mixed", InputContract.MIXED, _STATE + _EXPERT)
"""The sensor profile, then target speed and hazard flags of the privileged expert: 25 state variables."""
