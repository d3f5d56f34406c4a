"""Rows that a shard gives for the derived layers.

They are small, so that they travel between processes. Shards hold whole groups, so a map over them gives every row;
what needs all groups at once (clusters, split, thresholds, population, normalisation) is computed from these rows by
the room of its layer. Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from branchdrive.canonical.record import attempts, records
from branchdrive.driving.route_cluster import CLUSTER_POINTS, resample_polyline
from branchdrive.leakage.replays import replay_facts
from branchdrive.model.images import media_columns
from branchdrive.model.inputs import inputs_of
from branchdrive.model.objects import OBJECTS, object_columns
from branchdrive.model.targets import candidate_columns, ending_columns, scalar_columns, trajectory_columns
from branchdrive.quality.qualification import attempt_quality, group_quality
from branchdrive.quality.replay import Pairs, canonical_pairs, pair_columns
from branchdrive.quality.replay_frames import frame_columns
from branchdrive.raw.examination import Examination
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.frame import Frame

__all__ = ["REPLAYS", "REPLAY_FRAMES", "ROUTES", "raw_rows_of"]

REPLAYS = "replays"
REPLAY_FRAMES = "replay_frames"
ROUTES = "routes"


def raw_rows_of(view: ShardView, examination: Examination, optional: Collection[str]) -> dict[str, Frame]:
    """What the shard says, given which of its attempts and groups hold which rules.

    Args:
        view: The shard, without a structure failure.
        examination: What the rules found on it.
        optional: Optional tables that rows are wanted for; those of others are not computed.

    Returns:
        Frames by name. Those of the model layer hold every integrity-complete group, and so do three that are no
        tables: `ROUTES` with the resampled route of each group (`points`, ``[groups, 32, 2]``, metres in the frame
        of the town), `REPLAY_FRAMES` with what `quality.replay_frames` says of each pair, and `REPLAYS` with what a
        leakage audit may see of it.
    """
    selection = examination.selection
    complete = examination.complete_groups
    nominals = selection.nominal[complete]
    candidates = selection.chosen[complete]  # [groups, policies], all there
    bank = view.descriptor.action_bank
    interventions, replays = canonical_pairs(view, examination)
    pairs = Pairs(*(np.concatenate(sides) for sides in zip(interventions, replays, strict=True)))
    paired = pair_columns(view, pairs)
    executed = candidates.ravel()
    route_x, route_y = view.rollouts["route_x_m"], view.rollouts["route_y_m"]
    points = [resample_polyline(route_x[i], route_y[i]) for i in nominals]
    group_ids = np.array(view.group_ids, object)[complete]
    of_optional: Mapping[str, Callable[[], Frame]] = {
        "endings": lambda: ending_columns(view, executed),
        OBJECTS: lambda: object_columns(view, nominals),
    }
    return {
        "records": records(view, examination),
        "attempts": attempts(view, examination),
        "attempt_quality": attempt_quality(view, examination),
        "group_quality": group_quality(view, examination),
        "pairs": paired,
        **inputs_of(view, nominals),
        "candidates": candidate_columns(view, executed, np.repeat(nominals, len(bank.policies))),
        "scalars": scalar_columns(view, executed),
        "trajectories": trajectory_columns(view, executed),
        **{name: rows() for name, rows in of_optional.items() if name in optional},
        "media_index": media_columns(view, nominals),
        ROUTES: {
            "group_id": group_ids,
            "town": view.rollouts["town"][nominals],
            "points": np.array(points).reshape(len(points), CLUSTER_POINTS, 2),
        },
        REPLAY_FRAMES: frame_columns(view, pairs),
        REPLAYS: replay_facts(view, complete, candidates, replays.replay, pairs, paired),
    }
