"""Cases of the leakage rule on codes of the best action, in a release of sixty groups."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from tests.validator.engine.rules.case import boundary, mutant
from tests.validator.engine.rules.cases.model_inputs_features import renormalise
from tests.validator.engine.rules.release import SPLIT, ReleaseDraft

from branchdrive.tables.frame import Values, concat, take

NUM_COPIES = 4

BEST = ("brake_0.50", "steer_left_0.10", "accelerate_0.30")
"""Actions that are best in turn."""

CODES = (3.0, 9.0, 7.0)
"""Target speeds in their order, which rank nothing."""


def of_sixty_groups(d: ReleaseDraft) -> list[str]:
    """Copy every training group four times, on routes of their own; returns the groups in order."""
    contexts = d.frame("contexts")
    copied = {*contexts["group_id"][contexts["partition"] == "train"].tolist()}
    tables = [name for shard in d.tables.values() for name, table in shard.items() if "group_id" in table.schema.names]
    for name in tables:
        frame = d.frame(name)
        rows = np.array([group in copied for group in frame["group_id"].tolist()], bool)
        parts = [frame]
        for copy in range(1, NUM_COPIES + 1):
            part = take(frame, rows)
            for column in {"group_id", "rollout_id", "nominal_rollout_id"} & part.keys():
                part[column] = _renamed(part[column], copy)
            if "route_cluster" in part:
                part["route_cluster"] = part["route_cluster"] + 100 * copy
            parts.append(part)
        d.put(name, concat(parts))
    groups: list[str] = d.frame("contexts")["group_id"].tolist()
    return sorted(groups)


def _renamed(names: Values, copy: int) -> Values:
    """Names of a copy; what is masked stays so."""
    found = np.array([name and f"c{copy}{name}" for name in np.ma.getdata(names).tolist()], object)
    return np.ma.masked_array(found, np.ma.getmaskarray(names)) if isinstance(names, np.ma.MaskedArray) else found


def best_in_turn(d: ReleaseDraft, groups: list[str]) -> dict[str, int]:
    """Make one action in each group the best by every profile; returns which."""
    answers = {group: place % len(BEST) for place, group in enumerate(groups)}
    scalars = d.frame("scalars")
    pairs = zip(scalars["group_id"].tolist(), scalars["action_key"].tolist(), strict=True)
    is_best = np.array([BEST[answers[group]] == action for group, action in pairs])
    chosen = {"min_separation_m": (60.0, 4.0), "mean_jerk_mps3": (0.5, 8.0)}
    chosen |= {"max_accel_mps2": (1.0, 9.0), "max_yaw_rate_radps": (0.125, 1.5)}
    for column, (best, other) in chosen.items():
        scalars[column] = np.ma.array(np.where(is_best, best, other), mask=np.ma.getmaskarray(scalars[column]))
    d.put("scalars", scalars)
    return answers


def reseal(d: ReleaseDraft) -> None:
    """What follows from the copies, whose partitions nobody drew."""
    d.reseal("source", keep=("near_duplicates", "model"))
    renormalise(d)
    d.documents[SPLIT]["algorithm"] = "copies-1"
    d.reseal("card")


def hide(d: ReleaseDraft, code: Callable[[int, int], int]) -> None:
    """Make the target speed at one time a code of what follows from the place of a group and its best action."""
    groups = of_sixty_groups(d)
    for place, (group, answer) in enumerate(best_in_turn(d, groups).items()):
        d.set("expert", "target_speed_mps", CODES[code(place, answer)], group_id=group, offset_ticks=-40)
    reseal(d)


# BD-LKG-017: codes of the best action


@mutant("BD-LKG-017", at={"column": "expert target_speed_mps"}, base="alone")
def best_action_coded_in_a_target_speed(d: ReleaseDraft) -> None:
    hide(d, lambda _, answer: answer)


@boundary("BD-LKG-017", base="alone")
def target_speed_that_names_another_action_in_six_groups(d: ReleaseDraft) -> None:
    hide(d, lambda place, answer: (answer + (place < 6)) % len(CODES))


@mutant("BD-LKG-017", at={"column": "expert flags together"}, base="alone", findings=3)
def best_action_coded_in_flags(d: ReleaseDraft) -> None:
    groups = of_sixty_groups(d)
    for group, answer in best_in_turn(d, groups).items():
        for bit, offset in enumerate((-75, -20)):
            d.set("expert", "pedestrian_hazard", bool(answer >> bit & 1), group_id=group, offset_ticks=offset)
            d.set("expert", "vehicle_hazard", bool(answer >> (1 - bit) & 1), group_id=group, offset_ticks=offset)
    reseal(d)
