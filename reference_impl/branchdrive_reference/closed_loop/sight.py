"""What a selector may see at a decision: the drive up to its tick, and what it makes of the future if it looks ahead.

Inputs are those of the model layer, from the same formulas and at the same offsets from the tick of the decision.
Objects of others are measured as the model layer measures them; at every decision after the first one, all observations
of its window are measured again.

Sensor noise disturbs the recorded pose and speed of the window before anything is derived from them: at strength 1,
positions by 0.1 m, headings by 0.005 rad and speeds by 0.05 m/s, independent Gauss, equal for all selectors at the same
tick of a site. Controls are known without noise. The figures are this project's choice.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.collector.recording import Record, pose_columns
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.timing import HISTORY_OFFSETS, OBSERVATION_STRIDE_TICKS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.history import CONTROL_WINDOW, STATE_WINDOW, control_history, state_history
from branchdrive.driving.target import Targets
from branchdrive.model.arrays import pack_objects
from branchdrive.model.features import HISTORIES
from branchdrive.model.objects import seen_objects
from branchdrive.tables.frame import Values

__all__ = ["NOW", "SensorNoise", "Sight"]

Array = NDArray[np.float64]

NOW = "now"
"""Id of the one group of the frames of a sight."""

_SPREAD = {"x_m": 0.1, "y_m": 0.1, "yaw_rad": 0.005, "speed_mps": 0.05}


@dataclass(frozen=True)
class SensorNoise:
    """Noise on what is seen of a site; strength 0 changes nothing.

    Attributes:
        strength: Factor of all spreads.
        seed: Of the site.
    """

    strength: float
    seed: int

    def disturbed(self, columns: Mapping[str, Any], scene: Mapping[str, Any], tick: int) -> dict[str, Any]:
        """Columns of the observations of a window, the route state derived again from the disturbed pose."""
        if self.strength == 0.0:
            return dict(columns)
        key = hashlib.sha256(f"sensor noise:{self.seed}:{tick}".encode()).digest()
        random = np.random.Generator(np.random.PCG64(int.from_bytes(key[:8])))
        moved = {
            name: np.asarray(columns[name], np.float64)
            + self.strength * spread * random.standard_normal(len(columns[name]))
            for name, spread in _SPREAD.items()
        }
        x, y, yaw = (moved[name] for name in ("x_m", "y_m", "yaw_rad"))
        pose = pose_columns(x, y, yaw, scene["route_x_m"], scene["route_y_m"])
        found = {**columns, **{name: values for name, values in pose.items() if name in columns}}
        return {**found, "speed_mps": moved["speed_mps"].astype(np.float32)}


@dataclass(frozen=True, eq=False)
class Sight:
    """One decision.

    Attributes:
        group_id: Group, whose name decides the noise of objects.
        scenario_type: Scenario type, which no vehicle knows.
        record: What was recorded of the drive up to the tick, in it nothing after.
        tick: Tick of the decision, that of a saved observation.
        number: Number of the decision, from 0.
        unrecorded: Columns that the dataset does not record, as ``table.column``.
        noise: Noise on the history.
        look_ahead: Executed targets of every candidate from here ``[A, 6]``, what no vehicle could know.
    """

    group_id: str
    scenario_type: str
    record: Record
    tick: int
    number: int
    unrecorded: tuple[str, ...]
    noise: SensorNoise
    look_ahead: Callable[[], Targets]

    def history(self) -> dict[str, NDArray[np.float32]]:
        """Inputs of an exported selector: ``state`` ``[16, 21]`` and ``controls`` ``[80, 3]``, physical units."""
        state, controls = self._state(), self._controls()
        names = [feature.name for feature in HISTORIES["state"].features]
        nothing = np.full(len(HISTORY_OFFSETS), np.nan)
        return {
            "state": np.stack([state.get(name, nothing) for name in names], axis=1).astype(np.float32),
            "controls": np.stack(list(controls.values()), axis=1),
        }

    def objects(self) -> dict[str, NDArray[Any]]:
        """What sensors tell of others: ``objects`` ``[16, 32, 11]`` and ``objects_mask`` ``[16, 32]``."""
        rows, ticks = _rows(self.tick, HISTORY_OFFSETS), self.tick + np.array(HISTORY_OFFSETS)
        recorded = {name: np.ma.getdata(np.ma.asarray(values)) for name, values in self.record.actors.items()}
        first, last = (np.searchsorted(recorded["tick"], ticks, side=side) for side in ("left", "right"))
        of_window = slice(first[0], last[-1])
        name = self.group_id if self.number == 0 else f"{self.group_id}@{self.tick}"
        frame = seen_objects(
            {one: np.asarray(self.record.observations[one], np.float64)[rows] for one in ("x_m", "y_m", "yaw_rad")},
            {column: values[of_window] for column, values in recorded.items()},
            np.repeat(np.arange(len(ticks)), last - first),
            np.array([name], object),
        )
        packed = pack_objects(frame, [name])
        return {"objects": packed.values[0], "objects_mask": packed.available[0]}

    def frames(self) -> dict[str, dict[str, Values]]:
        """Frames of the model layer's tables with the one group `NOW`: what baselines see."""
        state, nothing = self._state(), np.full(len(HISTORY_OFFSETS), np.nan)
        features = [feature.name for feature in HISTORIES["state"].features]
        return {
            "contexts": {
                "group_id": np.array([NOW], object),
                "scenario_type": np.array([self.scenario_type], object),
                "town": np.array([self.record.fields["town"]], object),
            },
            "state": {
                **_keys(HISTORY_OFFSETS),
                **{name: np.ma.masked_invalid(state.get(name, nothing)) for name in features},
            },
            "past_controls": {**_keys(CONTROL_WINDOW), **self._controls()},
            "expert": self._copied("expert", self.record.observations),
            "surroundings": self._copied("surroundings", self.record.evidence),
        }

    def _state(self) -> dict[str, Array]:
        profile = SENSOR_PROFILE.without(self.unrecorded)
        rows = _rows(self.tick, STATE_WINDOW)
        seen = {
            name: np.asarray(values)[rows]
            for name, values in self.record.observations.items()
            if name in (*profile.state_columns, *_SPREAD)
        }
        seen = self.noise.disturbed(seen, self.record.fields, self.tick)
        columns = {name: np.asarray(seen[name])[None] for name in profile.state_columns}
        ticks = (self.tick + np.array(STATE_WINDOW))[None]
        history = state_history(profile, columns, tick=ticks, branch_tick=np.array([self.tick]))
        return dict(zip((feature.name for feature in profile.state), history.values[0].T, strict=True))

    def _controls(self) -> dict[str, NDArray[np.float32]]:
        rows = self.tick + np.array(CONTROL_WINDOW)
        columns = {name: np.asarray(self.record.controls[name])[rows][None] for name in SENSOR_PROFILE.control_columns}
        history = control_history(SENSOR_PROFILE, columns, tick=rows[None], branch_tick=np.array([self.tick]))
        names = [feature.name for feature in SENSOR_PROFILE.controls]
        return dict(zip(names, history.values[0].T.astype(np.float32), strict=True))

    def _copied(self, name: str, recorded: Mapping[str, Any]) -> dict[str, Values]:
        if not recorded:
            return {}
        rows = _rows(self.tick, HISTORY_OFFSETS)
        frame: dict[str, Values] = _keys(HISTORY_OFFSETS)
        for column in LAYER_TABLES[name].value_columns:
            values = recorded[column.name]
            masked = np.ma.asarray(values) if isinstance(values, np.ma.MaskedArray) else _masked(values)
            frame[column.name] = masked[rows] if column.nullable else np.ma.getdata(masked)[rows]
        return frame


def _masked(values: Any) -> np.ma.MaskedArray[Any, Any]:
    """Values with ``None`` masked."""
    listed = values if isinstance(values, np.ndarray) and values.dtype != object else np.array(list(values), object)
    missing = [value is None for value in listed] if listed.dtype == object else np.zeros(len(listed), np.bool_)
    return np.ma.masked_array(listed, missing)


def _keys(offsets: tuple[int, ...]) -> dict[str, Values]:
    return {"group_id": np.array([NOW] * len(offsets), object), "offset_ticks": np.array(offsets, np.int32)}


def _rows(tick: int, offsets: tuple[int, ...]) -> NDArray[np.int64]:
    """Rows of saved observations at offsets from a tick."""
    return np.asarray((tick + np.array(offsets)) // OBSERVATION_STRIDE_TICKS)
