"""What the vehicle of a shard's attempts did: responses of interventions, and tracks that tell copies.

Source: spec/07-rules.md#response.
"""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Mask
from branchdrive.contract.timing import ACTIVE_TICKS, FUTURE_OFFSETS, HISTORY_OFFSETS, PREDECESSOR_OFFSET
from branchdrive.driving.angle import wrap_rad
from branchdrive.driving.response import TURN_OFFSET, Responses, first_response, lateral_effect_m
from branchdrive.files.group_marks import Tracks
from branchdrive.files.identities import Identities
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.shard_view import ShardView
from branchdrive.raw.window import take_float, window_rows

__all__ = ["Executed", "group_digests", "observed_extremes", "responses", "tracks"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STATE = ("x_m", "y_m", "yaw_rad", "speed_mps")
_RATES = ("accel_longitudinal_mps2", "accel_lateral_mps2", "yaw_rate_radps")
_EXPERT = ("expert_steer", "expert_throttle", "expert_brake")
_COMMAND = ("applied_steer", "applied_throttle", "applied_brake")
_OFFSETS = (PREDECESSOR_OFFSET, *HISTORY_OFFSETS, *FUTURE_OFFSETS)
_NUM_BEFORE = len(HISTORY_OFFSETS)  # the predecessor and the history but for t_b
_BRANCH, _TURNED = _OFFSETS.index(0), _OFFSETS.index(TURN_OFFSET)
_MOVING_MPS = 0.5


class Executed(NamedTuple):
    """Chosen interventions and the chosen nominals of their groups, whose windows are whole; see `responses`.

    Attributes:
        group: Group of the shard ``[interventions]``.
        policy: Index into the bank ``[interventions]``.
        own: Attempt of the shard ``[interventions]``.
        nominal: The nominal ``[interventions]``.
        state: Pose and speed from ``t_b - 80`` to ``t_b + 50`` ``[4, interventions, 27]``.
        reference: The same of the nominal.
        command: Applied controls from ``t_b`` to ``t_b + 49`` ``[3, interventions, 50]``.
        wanted: The same of the nominal.
        expert: Commands of the expert from ``t_b - 1`` to ``t_b + 50`` ``[3, interventions, 52]``, NaN without a row.
    """

    group: Index
    policy: Index
    own: Index
    nominal: Index
    state: Array
    reference: Array
    command: Array
    wanted: Array
    expert: Array


def responses(view: ShardView, selection: Selection, broken: Mask) -> tuple[Executed, Responses]:
    """Chosen interventions of the shard with the chosen nominal of their group, and what they do.

    Left out are attempts that break a structure rule, those without every observation from ``t_b - 80`` to
    ``t_b + 50`` or without every active control, and those with values there that are no numbers.
    """
    known, key = (
        view.cached(_known),
        tuple(values.tobytes() for values in (selection.chosen, selection.nominal, broken)),
    )
    if key not in known:
        interventions = _executed(view, selection, broken)
        known[key] = interventions, _responses_of(view, interventions)
    return known[key]


def _known(_view: ShardView) -> dict[tuple[bytes, ...], tuple[Executed, Responses]]:
    return {}


@np.errstate(all="ignore")  # what overflows is no number, and is left out
def _executed(view: ShardView, selection: Selection, broken: Mask) -> Executed:
    group, policy = np.nonzero(selection.chosen >= 0)
    own, nominal = selection.chosen[group, policy], selection.nominal[group]
    same_branch = view.branched[own] & (view.branch_tick[own] == view.branch_tick[nominal])
    kept = (nominal >= 0) & (policy != view.descriptor.action_bank.nominal_index) & same_branch
    kept &= ~(broken[own] | broken[nominal])
    own, nominal, policy, group = own[kept], nominal[kept], policy[kept], group[kept]
    state, reference = (_values(view, "observations", rollouts, _STATE, _OFFSETS) for rollouts in (own, nominal))
    around = _values(view, "controls", own, (*_COMMAND, *_EXPERT), range(-1, ACTIVE_TICKS + 1))
    command, wanted = around[:3, :, 1:-1], _values(view, "controls", nominal, _COMMAND, range(ACTIVE_TICKS))
    kept = np.isfinite(state - reference).all(axis=(0, 2)) & np.isfinite(command - wanted).all(axis=(0, 2))
    attempts = (values[kept] for values in (group, policy, own, nominal))
    return Executed(*attempts, *(values[:, kept] for values in (state, reference, command, wanted, around[3:])))


@np.errstate(all="ignore")
def _responses_of(view: ShardView, found: Executed) -> Responses:
    state, reference, command, wanted, expert = found[4:]
    past = _OFFSETS[: _NUM_BEFORE + 2]
    rates, known = (_values(view, "observations", rollouts, _RATES, past) for rollouts in (found.own, found.nominal))
    steer, throttle, brake = (command - wanted).mean(axis=2)
    (x, y, _, speed), (x_0, y_0, yaw_0, speed_0) = state[:, :, -1], reference[:, :, -1]
    first = first_response((state != reference).any(axis=0), _NUM_BEFORE)
    differs = (rates != known).any(axis=0)
    first[(first > 0) & differs[:, _NUM_BEFORE] & ~differs[:, :_NUM_BEFORE].any(axis=1)] = 0
    turns = state[2] - reference[2]
    _, first_of, which = np.unique(found.nominal, return_index=True, return_inverse=True)
    return Responses(
        group=view.cached(group_digests)[found.group],
        policy=found.policy,
        steer=steer,
        drive=throttle - brake,
        lateral_m=lateral_effect_m(x, y, x_0, y_0, yaw_0),
        turn_rad=wrap_rad(turns[:, _TURNED] - turns[:, _BRANCH]),
        speed_mps=speed - speed_0,
        first=first,
        moves=np.asarray((np.abs(reference[3, :, _NUM_BEFORE:]) > _MOVING_MPS).all(axis=1)),
        accel_mps2=(rates - known)[0, :, _NUM_BEFORE:],
        began_mps=state[3, :, _BRANCH],
        gain_mps=speed - state[3, :, _BRANCH],
        future=_futures(state),
        nominal_future=_futures(reference[:, first_of])[which],
        expert=_while_overridden(expert, command, wanted),
    )


def _futures(state: NDArray[np.float64]) -> Index:
    """Digests of what follows the branch, to three decimals; states are ``[columns, rollouts, offsets]``."""
    after = np.ascontiguousarray(np.round(state[:, :, _NUM_BEFORE + 1 :].swapaxes(0, 1), 3) + 0.0)
    return np.array([_digest(track.data) for track in after], np.int64)


def _while_overridden(
    expert: NDArray[np.float64], applied: NDArray[np.float64], nominal: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """`Responses.expert`: commands from ``t_b - 1`` to ``t_b + 50``, and those of the active ticks alone."""
    active = expert[:, :, 1:-1]
    seen = [
        (expert != expert[:, :, :1]).any(axis=2), (active == active[:, :, :1]).all(axis=2),
        (active == nominal).all(axis=2), (active == applied).all(axis=2),
    ]  # fmt: skip
    pedals = [seen[0][1] | seen[0][2], *(values[1] & values[2] for values in seen[1:])]
    return np.stack([np.stack([values[0] for values in seen], axis=1), np.stack(pedals, axis=1)], axis=1)


def group_digests(view: ShardView) -> Index:
    """63 bits of a digest of the id of each group of the shard ``[groups]``."""
    return np.array([_digest(group_id.encode()) for group_id in view.group_ids], np.int64)


def _digest(content: bytes | memoryview) -> int:
    """63 bits of a SHA-256."""
    return int.from_bytes(hashlib.sha256(content).digest()[:8], "little") >> 1


def _values(
    view: ShardView, table: str, rollouts: Index, columns: tuple[str, ...], offsets: range | tuple[int, ...]
) -> NDArray[np.float64]:
    """Values at offsets from ``t_b``, ``[columns, rollouts, offsets]``, NaN where there is no row."""
    stream = view.stream(table)
    rows = window_rows(view, stream, rollouts, offsets)
    values = np.stack([take_float(stream, column, rows) for column in columns]) if len(stream) else None
    return np.full((len(columns), *rows.shape), np.nan) if values is None else np.where(rows >= 0, values, np.nan)


def tracks(view: ShardView) -> Tracks:
    """What the ego did in the attempts of each group.

    Attempts that are too short for a history are left out: standing at the start is no copy.
    """
    stream = view.observations
    columns = [stream.tick.astype(np.float64), *(stream[name].astype(np.float64) for name in _STATE)]
    track = np.ascontiguousarray(np.stack(columns, axis=1))
    found: set[tuple[int, int]] = set()
    for i, (start, stop) in enumerate(zip(stream.start.tolist(), stream.stop.tolist(), strict=True)):
        if stop - start > len(HISTORY_OFFSETS):
            digest = hashlib.sha256(track[start:stop].data).digest()[:8]
            found.add((int(view.group[i]), int.from_bytes(digest, "little")))
    groups, digests = zip(*sorted(found), strict=True) if found else ((), ())
    return Tracks(Identities(view.group_ids), np.array(groups, np.int32), np.array(digests, np.uint64))


def observed_extremes(view: ShardView) -> dict[str, tuple[float, float]]:
    """Smallest and largest value of every column of numbers of the observations."""
    numbers = [column.name for column in TABLES["observations"].columns if column.type.startswith("float")]
    bounds = {name: view.observations.extremes(name) for name in numbers}
    return {name: (float(least), float(most)) for name, (least, most) in bounds.items()}
