"""Everything that a shard of the raw layer says to the derived layers: small, so that it travels between processes.

Shards hold whole groups, so a map over them gives every row; what needs all groups at once (clusters,
split, thresholds, population, normalisation) is computed from these rows by `branchdrive.derive.layer`.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.extract.candidate import attempts, records
from branchdrive.audit.extract.future import candidate_columns, scalar_columns, trajectory_columns
from branchdrive.audit.extract.history import inputs_of
from branchdrive.audit.extract.media import media_columns
from branchdrive.audit.extract.metamorphic import changed_groups
from branchdrive.audit.extract.replay import Pairs, pair_columns
from branchdrive.audit.extract.replay_input import ReplayBlock, replay_block
from branchdrive.audit.extract.standing import attempt_quality, group_standing, nominal_replays
from branchdrive.audit.view import ShardView
from branchdrive.derive.cluster import CLUSTER_POINTS, resample_polyline
from branchdrive.derive.layer.frame import Values, concat

if TYPE_CHECKING:
    from branchdrive.audit.examination import Examination

__all__ = ["Extract", "extract_shard", "merge"]

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Extract:
    """What raw rows say to the derived layers.

    Attributes:
        frames: Rows by table. The tables of the model layer hold every integrity-complete group.
        route_groups: Integrity-complete groups ``[routes]``.
        route_towns: Town of each ``[routes]``.
        routes: Resampled route of each ``[routes, 32, 2]``, metres in the frame of the town.
        replays: What a leakage audit may see of those groups.
        changed: Groups whose inputs changed, by metamorphic step; ``None`` where the steps were not taken.
    """

    frames: dict[str, dict[str, Values]]
    route_groups: tuple[str, ...]
    route_towns: tuple[str, ...]
    routes: NDArray[np.float64]
    replays: ReplayBlock
    changed: dict[str, tuple[str, ...]] | None = None


def extract_shard(view: ShardView, examination: Examination, *, metamorphic: bool = False) -> Extract:
    """What the shard says, given which of its attempts and groups hold which rules.

    Args:
        view: The shard, without a structure failure.
        examination: What the rules found on it.
        metamorphic: Whether to take the metamorphic steps too.
    """
    selection = examination.selection
    complete = np.flatnonzero([s.is_integrity_complete for s in examination.standings]).astype(np.int64)
    nominals = selection.nominal[complete]
    candidates = selection.chosen[complete]  # [groups, policies], all there
    bank = view.descriptor.action_bank
    replays = nominal_replays(view, examination)
    replays = replays[np.isin(view.group[replays], complete)]
    others = np.delete(candidates, bank.nominal_index, axis=1).ravel()
    pairs = Pairs(
        np.concatenate([others, replays]).astype(np.int64),
        np.concatenate([np.repeat(nominals, len(bank.policies) - 1), selection.nominal[view.group[replays]]]).astype(
            np.int64
        ),
    )
    paired = pair_columns(view, pairs)
    executed = candidates.ravel()
    frames = {
        "records": records(view, examination),
        "attempts": attempts(view, examination),
        "attempt_quality": attempt_quality(view, examination),
        "group_quality": group_standing(view, examination),
        "pairs": paired,
        **inputs_of(view, nominals),
        "candidates": candidate_columns(view, executed, np.repeat(nominals, len(bank.policies))),
        "scalars": scalar_columns(view, executed),
        "trajectories": trajectory_columns(view, executed),
        "media_index": media_columns(view, nominals),
    }
    route_x, route_y = view.rollouts["route_x_m"], view.rollouts["route_y_m"]
    routes = [resample_polyline(route_x[i], route_y[i]) for i in nominals]
    return Extract(
        frames,
        tuple(view.group_ids[g] for g in complete),
        tuple(view.rollouts["town"][nominals].tolist()),
        np.array(routes).reshape(len(routes), CLUSTER_POINTS, 2),
        replay_block(view, complete, candidates, replays, pairs, paired),
        changed_groups(view, nominals, candidates) if metamorphic else None,
    )


def merge(parts: list[Extract]) -> Extract:
    """What several shards say together; the order of the parts decides the order of the rows and nothing else.

    Raises:
        ValueError: There is no part.
    """
    frames: dict[str, dict[str, Any]] = {
        name: concat([part.frames[name] for part in parts]) for name in parts[0].frames
    }
    changed = None
    if all(part.changed is not None for part in parts):
        changed = {
            step: tuple(sorted(g for part in parts for g in (part.changed or {})[step]))
            for step in (parts[0].changed or {})
        }
    return Extract(
        frames,
        tuple(g for part in parts for g in part.route_groups),
        tuple(t for part in parts for t in part.route_towns),
        np.concatenate([part.routes for part in parts]),
        ReplayBlock.merge([part.replays for part in parts]),
        changed,
    )
