"""History of a branch: the state and the controls of the nominal rollout before ``t_b``.

With ``j = 0 .. 16`` the observations at ``t_b - 80 .. t_b``, ``b = 16`` that of the branch and
``dt = 0.25 s``, row ``j - 1`` of a state history holds, for ``j = 1 .. 16``::

    rel_x, rel_y     = R(-yaw_b) (p_j - p_b)          rel_sin, rel_cos = sin, cos (yaw_j - yaw_b)
    turn_j           = wrap(yaw_j - yaw_{j-1})        mean_yaw_rate_j  = turn_j / dt
    accel_longitudinal_j = (v_j - v_{j-1}) cos(turn_j / 2) / dt
    accel_lateral_j      = (v_j + v_{j-1}) sin(turn_j / 2) / dt

and the recorded values of its other features, the command as a one-hot. The accelerations are
``(vel_j - vel_{j-1}) / dt`` with ``vel = v (cos yaw, sin yaw)``, as in the targets, along and across the
mean of the two headings, so that a steady circle has none along it. They and the yaw rate are backward
differences of pose and speed; the first row needs the observation at ``t_b - 80``, which enters nothing
else. The recorded columns of acceleration and yaw rate are not used: what they average over is the
a detail of the simulator.

A control history holds the applied controls of ``t_b - 80 .. t_b - 1``. A row whose tick is not exactly
the one of its window is refused, so no row of ``t_b`` or after can enter by mistake.

Source: paper, "Model Inputs and Targets"; which 21 variables and their formulas are this project's choice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.timing import CONTROL_HISTORY_TICKS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.feature import Feature, InputProfile
from branchdrive.driving.target import STEP_S
from branchdrive.errors import UsageError

__all__ = ["CONTROL_WINDOW", "STATE_WINDOW", "HistoryInput", "control_history", "history_of", "state_history"]

Array = NDArray[np.float64]

STATE_WINDOW = (PREDECESSOR_OFFSET, *HISTORY_OFFSETS)
"""Offsets from ``t_b`` of the observations that a state history is computed from: -80, -75, .. 0."""

CONTROL_WINDOW = tuple(range(-CONTROL_HISTORY_TICKS, 0))
"""Offsets from ``t_b`` of the controls of a control history: -80, -79, .. -1."""


class HistoryInput(NamedTuple):
    """Histories: `values` ``[groups, rows, features]``, NaN where not `available` ``[groups, rows]``."""

    values: Array
    available: NDArray[np.bool_]


def state_history(
    profile: InputProfile, columns: Mapping[str, ArrayLike], *, tick: ArrayLike, branch_tick: ArrayLike
) -> HistoryInput:
    """State before the branch, ``[groups, 16, features]`` in the order of ``profile.state``.

    A row is available where all its features are finite numbers and its command is a declared one.

    Args:
        profile: Features to compute.
        columns: Exactly ``profile.state_columns`` of the observations at `STATE_WINDOW`, each ``[groups, 17]``.
        tick: Ticks of those observations ``[groups, 17]``.
        branch_tick: ``t_b`` ``[groups]``.

    Raises:
        UsageError: `columns` has other columns than the profile, or a feature has no formula.
        ValueError: A column has another shape, or a tick is not that of its place in the window.
    """
    shape = _checked_window(tick, branch_tick, STATE_WINDOW)
    window = _checked_columns(columns, profile.state_columns, shape, profile.name)
    with np.errstate(over="ignore", invalid="ignore"):
        return _masked(np.stack([_computed(feature, window) for feature in profile.state], axis=2))


def control_history(
    profile: InputProfile, columns: Mapping[str, ArrayLike], *, tick: ArrayLike, branch_tick: ArrayLike
) -> HistoryInput:
    """Applied controls before the branch, ``[groups, 80, controls]`` in the order of ``profile.controls``.

    Args:
        profile: Controls to hold.
        columns: Exactly ``profile.control_columns`` of the control rows at `CONTROL_WINDOW`, each ``[groups, 80]``.
        tick: Ticks of those rows ``[groups, 80]``.
        branch_tick: ``t_b`` ``[groups]``.

    Raises:
        UsageError: `columns` has other columns than the profile.
        ValueError: A column has another shape, or a tick is not that of its place in the window.
    """
    shape = _checked_window(tick, branch_tick, CONTROL_WINDOW)
    window = _checked_columns(columns, profile.control_columns, shape, profile.name)
    return _masked(np.stack([window[feature.columns[0]] for feature in profile.controls], axis=2))


_Window = Mapping[str, Array]


def _computed(feature: Feature, window: _Window) -> Array:
    """A feature ``[groups, 16]``; its formula sees the columns that it declares and no others."""
    declared = {column: window[column] for column in feature.columns}
    formula = _FORMULAS.get(feature.name)
    try:
        return formula(declared) if formula else declared[feature.name][:, 1:]
    except KeyError as missing:
        found = f"column {missing}, which it does not declare"
        raise UsageError(f"the formula of the feature `{feature.name}` reads the {found}") from None


def _relative_position(window: _Window) -> tuple[Array, Array]:
    dx, dy = (window[name][:, 1:] - window[name][:, -1:] for name in ("x_m", "y_m"))
    cos, sin = np.cos(window["yaw_rad"][:, -1:]), np.sin(window["yaw_rad"][:, -1:])
    return cos * dx + sin * dy, cos * dy - sin * dx


def _relative_yaw(window: _Window) -> Array:
    return np.asarray(window["yaw_rad"][:, 1:] - window["yaw_rad"][:, -1:])


def _turn(window: _Window) -> Array:
    return wrap_rad(np.diff(window["yaw_rad"], axis=1))


def _accel_longitudinal(window: _Window) -> Array:
    return np.asarray(np.diff(window["speed_mps"], axis=1) * np.cos(_turn(window) / 2) / STEP_S)


def _accel_lateral(window: _Window) -> Array:
    speed = window["speed_mps"]
    return np.asarray((speed[:, 1:] + speed[:, :-1]) * np.sin(_turn(window) / 2) / STEP_S)


_COMMANDS = TABLES["observations"]["command"].values


def _is_command(code: int) -> Callable[[_Window], Array]:
    def one_hot(window: _Window) -> Array:
        codes = window["command"][:, 1:]
        return np.where(np.isfinite(codes), (codes == code).astype(np.float64), np.nan)

    return one_hot


_FORMULAS: Mapping[str, Callable[[_Window], Array]] = {
    "rel_x_m": lambda window: _relative_position(window)[0],
    "rel_y_m": lambda window: _relative_position(window)[1],
    "rel_sin_yaw": lambda window: np.sin(_relative_yaw(window)),
    "rel_cos_yaw": lambda window: np.cos(_relative_yaw(window)),
    "mean_accel_longitudinal_mps2": _accel_longitudinal,
    "mean_accel_lateral_mps2": _accel_lateral,
    "mean_yaw_rate_radps": lambda window: np.asarray(_turn(window) / STEP_S),
    **{f"command_{value}": _is_command(code) for code, value in enumerate(_COMMANDS)},
}
"""Formulas ``[groups, 17] -> [groups, 16]`` by feature; any other feature is the column of its name."""


def _checked_window(tick: ArrayLike, branch_tick: ArrayLike, offsets: tuple[int, ...]) -> tuple[int, int]:
    """Shape ``(groups, rows)`` of the window, whose ticks are exactly ``branch_tick + offsets``."""
    ticks, branch_ticks = np.asarray(tick), np.asarray(branch_tick)
    shape = (len(branch_ticks) if branch_ticks.ndim else 0, len(offsets))
    if branch_ticks.ndim != 1 or ticks.shape != shape:
        found = f"`tick` has shape {list(ticks.shape)} and `branch_tick` {list(branch_ticks.shape)}"
        raise ValueError(f"{found}, not [groups, {len(offsets)}] and [groups]")
    wanted = branch_ticks[:, None] + np.array(offsets)
    for group, row in np.argwhere(ticks != wanted)[:1].tolist():
        raise ValueError(
            f"group {group}, row {row}: tick {ticks[group, row]}, expected {wanted[group, row]}; "
            f"the window is t_b{offsets[0]:+} .. t_b{offsets[-1]:+} in order"
        )
    return shape


def _checked_columns(
    columns: Mapping[str, ArrayLike], wanted: tuple[str, ...], shape: tuple[int, int], profile: str
) -> _Window:
    """The wanted columns in float64, the command as the code of its value and NaN where it is none."""
    if set(columns) != set(wanted):
        extra, missing = sorted(set(columns) - set(wanted)), sorted(set(wanted) - set(columns))
        raise UsageError(f"profile {profile!r} takes exactly its columns; not admitted {extra}, missing {missing}")
    window = {}
    for name in wanted:
        values = np.asarray(columns[name])
        if values.shape != shape:
            raise ValueError(f"`{name}` has shape {list(values.shape)}, not {list(shape)}: [groups, rows]")
        if name == "command":
            codes = np.full(shape, np.nan)
            for code, value in enumerate(_COMMANDS):
                codes[values.astype(np.str_) == value] = code
            values = codes
        window[name] = values.astype(np.float64)
    return window


def history_of(values: Array) -> HistoryInput:
    """Histories ``[groups, rows, features]`` with what is no number; a feature that nowhere is one is not recorded.

    A row is available where all recorded features are finite.
    """
    is_number = np.isfinite(values)
    available = np.asarray((is_number | ~is_number.any(axis=(0, 1))).all(axis=2))
    return HistoryInput(values, available)


def _masked(values: Array) -> HistoryInput:
    available = np.asarray(np.isfinite(values).all(axis=2))
    return HistoryInput(np.where(available[..., None], values, np.nan), available)
