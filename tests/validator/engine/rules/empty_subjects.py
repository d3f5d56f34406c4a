"""Ways to leave rules on the raw layer with nothing to compare, though attempts, rows and files are there.

Each is a small function on a valid draft, registered for the rules that it empties. What else fails does not matter.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.synthetic import BRANCH_TICK, group_name
from tests.validator.engine.rules.case import SHARD_1, Base, Edit
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.semantic_map import add_semantic_map

from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.contract.policy import ACTUATORS
from branchdrive.contract.rule import CATALOGUE

__all__ = ["ALWAYS", "EMPTIED", "Emptied"]

ALWAYS = frozenset(
    {
        "BD-LAY-001", "BD-LAY-004", "BD-LAY-005", "BD-LAY-006", "BD-LAY-007", "BD-LAY-009", "BD-DOC-001", "BD-TAB-006",
    }
)  # fmt: skip
"""Rules with a subject wherever there is a dataset: what is not there is what they find."""


@dataclass(frozen=True)
class Emptied:
    """A dataset on which rules have nothing to compare.

    Attributes:
        edit: Changes a valid draft.
        base: Which one.
        rules: The rules that are skipped then, since they have no subject.
    """

    edit: Edit
    base: Base
    rules: tuple[str, ...]


EMPTIED: dict[str, Emptied] = {}
"""By name."""


def empties(*areas: str, base: Base = "full") -> Callable[[Edit], Edit]:
    """Register a function that empties rules, which are named by their area and numbers, as in `CTL 003 004`."""

    def register(edit: Edit) -> Edit:
        rules = [f"BD-{area}-{number}" for area, *numbers in map(str.split, areas) for number in numbers]
        assert edit.__name__ not in EMPTIED
        assert set(rules) <= set(CATALOGUE)
        EMPTIED[edit.__name__] = Emptied(edit, base, tuple(rules))
        return edit

    return register


OF_ATTEMPTS = (
    "TIC 001 002 003", "CTL 001 002 003 004 005 006 007 008 009 010 011 012 013 014 015", "WIN 001 002 003 004 005",
    "EVD 001 002 003", "RTE 001 002 003 004 005", "MOT 001 002 003 004 005 006", "ACT 001 002 003 004 005 006 007 008",
    "TRG 001 002 003", "BOX 002", "RES 001 002 004 005 006", "BNK 002",
    "GRP 001 002 003 004 005 006 007 008 009 010 011", "RSP 001 002 003 004 006 010 015", "RPN 001 002 003 005",
)  # fmt: skip
"""Rules on attempts that are complete, and on the groups of these."""

OF_IMAGES = ("FRM 001 002 003 005 006 007 008 010 011 013", "RSP 014", "RPN 004 006")
"""Rules on images and their index."""


def _without_rows(d: Draft, *tables: str) -> None:
    for shard in d.tables.values():
        for name in tables or tuple(shard):
            if name in shard:
                shard[name] = shard[name].slice(0, 0)


@empties("LAY 010", "DOC 006", "CTL 015", "ACT 005 006 007", "RES 006", "RSP 004", "RPN 001 003")
def nothing_is_changed(d: Draft) -> None:
    pass


@empties(
    "TAB 007", "VAL 001 002 003 004 005 006 007", "BOX 001 003", "NUL 001 002 003 004 005 006",
    "KEY 001 002 003 004 005 006 007 008", "STA 001", "BNK 001", "RSP 005 007 016", *OF_ATTEMPTS, *OF_IMAGES, "WIN 006",
    base="media",
)  # fmt: skip
def nothing_is_recorded(d: Draft) -> None:
    _without_rows(d)


@empties("KEY 009", base="drives")
def nothing_is_decided(d: Draft) -> None:
    _without_rows(d)


@empties("CTL 016", base="drives")
def nobody_decides(d: Draft) -> None:
    for rollout_id in d.take("rollouts", role="drive")["rollout_id"].to_pylist():
        d.drop_attempt(rollout_id)


@empties("MAP 001 002 003 004 005 006 007 008 009 010 011 012", base="map")
def nothing_is_mapped(d: Draft) -> None:
    _without_rows(d)


@empties(*OF_ATTEMPTS, "RSP 007 016", "FRM 006 010 011", "WIN 006", base="media")
def nobody_is_complete(d: Draft) -> None:
    d.set("rollouts", "status", "partial")
    d.set("rollouts", "status_reason", "stopped")


@empties("MAP 005 006 007 008 009", base="map")
def nobody_is_complete_on_a_map(d: Draft) -> None:
    nobody_is_complete(d)


@empties(
    "KEY 005", "CTL 001 002 003 004 005 006 007 008 010 012", "BNK 002",
    "GRP 001 002 003 004 005 006 007 008 009 010 011", "RSP 001 002 003 004 010 015", "RPN 001 002 003 005",
)  # fmt: skip
def nominals_are_alone(d: Draft) -> None:
    for rollout_id in d.take("rollouts", role=["intervention", "nominal_replay"])["rollout_id"].to_pylist():
        d.drop_attempt(rollout_id)


@empties("CTL 003 004 005 006 007 008 010")
def nothing_is_active(d: Draft) -> None:
    d.set("controls", "active", False)
    d.set("controls", "source", "online_expert")
    d.set("controls", tuple(f"{kind}_{name}" for kind in ("intended", "nominal") for name in ACTUATORS), None)


@empties("CTL 009")
def everything_is_active(d: Draft) -> None:
    d.set("controls", "active", True)
    d.set("controls", "source", "intervention")
    d.set("controls", tuple(f"{kind}_{name}" for kind in ("intended", "nominal") for name in ACTUATORS), 0.0)


@empties("CTL 001")
def controls_begin_at_the_branch(d: Draft) -> None:
    d.drop("controls", tick=range(BRANCH_TICK))
    for rollout_id in d.take("rollouts")["rollout_id"].to_pylist():
        d.recount(rollout_id)


@empties("CTL 001 002 003 004 005 006 007 008 009 010 011 013", "NUL 003")
def controls_are_lost(d: Draft) -> None:
    _without_rows(d, "controls")
    d.set("rollouts", "num_ticks", 0)


@empties(
    "RTE 001 002 003 004 005", "MOT 001 002 003", "RES 001 002 004 005 006", "WIN 005 006", "EVD 001 002 003",
    "ACT 001 002 003 004 005", "RPN 001 002 003 005", "FRM 003 006 010 011", base="media",
)  # fmt: skip
def observations_are_lost(d: Draft) -> None:
    _without_rows(d, "observations", "evidence", "actors", "frames")
    d.set("rollouts", "num_observations", 0)


@empties("RTE 005")
def no_command_is_to_turn(d: Draft) -> None:
    d.set("observations", "command", "follow")


@empties("MAP 005 006 007 008 009", base="map")
def observations_on_a_map_are_lost(d: Draft) -> None:
    observations_are_lost(d)


@empties("NUL 002 005", "WIN 005", "EVD 001 002 003", "MOT 005", "RES 001 004 005 006")
def evidence_is_lost(d: Draft) -> None:
    _without_rows(d, "evidence")


@empties("MAP 005 006 008 009", base="map")
def evidence_on_a_map_is_lost(d: Draft) -> None:
    _without_rows(d, "evidence")


@empties("ACT 001 002 003 004 005 006 007", "RSP 015")
def actors_are_lost(d: Draft) -> None:
    _without_rows(d, "actors")


@empties(*OF_IMAGES, base="media")
def images_are_lost(d: Draft) -> None:
    _without_rows(d, "frames")


@empties("FRM 009 012 016 017", base="media")
def semantic_maps_are_lost(d: Draft) -> None:
    add_semantic_map(d)
    _without_rows(d, "frames")


@empties("FRM 004 009 012 016 017", base="media")
def attempts_with_semantic_maps_are_not_complete(d: Draft) -> None:
    add_semantic_map(d)
    _without_rows(d, "frames")
    nobody_is_complete(d)


@empties("RES 001 004 005 006")
def nothing_is_counted(d: Draft) -> None:
    for kind in ("vehicle_collisions", "pedestrian_collisions", "static_collisions"):
        d.set("rollouts", f"result_num_{kind}", None)
    for kind in ("off_road", "red_light", "stop_sign"):
        d.set("rollouts", f"result_num_{kind}_infractions", None)


@empties("RES 001")
def collisions_with_things_alone_are_counted(d: Draft) -> None:
    d.set("rollouts", ("result_num_vehicle_collisions", "result_num_pedestrian_collisions"), None)
    d.set("rollouts", "result_num_static_collisions", 0)


@empties("RES 005")
def nobody_is_in_contact(d: Draft) -> None:
    d.set("evidence", "collision", False)


@empties("GRP 009 011", "RSP 002 010")
def every_vehicle_stands(d: Draft) -> None:
    d.set("observations", "speed_mps", 0.0)


@empties("RPN 002")
def one_replay_of_a_shard_is_alone(d: Draft) -> None:
    replays = d.take("rollouts", role="nominal_replay")["rollout_id"].to_pylist()
    for rollout_id in set(replays) - {f"{group_name(index)}.nominal_replay.a1" for index in (0, 2)}:
        d.drop_attempt(rollout_id)


@empties("RSP 005 015")
def one_group_is_alone(d: Draft) -> None:
    del d.tables[SHARD_1]
    for rollout_id in d.take("rollouts", group_id=group_name(1))["rollout_id"].to_pylist():
        d.drop_attempt(rollout_id)


@empties("MAP 004", base="map")
def one_shard_is_alone(d: Draft) -> None:
    del d.tables[SHARD_1]


@empties("MAP 009", base="map")
def every_town_has_signals(d: Draft) -> None:
    pass


@empties("MAP 008", base="map")
def no_town_has_walls(d: Draft) -> None:
    d.drop("map", kind="wall")


@empties("MAP 007", base="map")
def lanes_have_no_limit(d: Draft) -> None:
    d.set("map", "speed_limit_mps", None)


@empties("MAP 007", base="map")
def limits_are_not_recorded(d: Draft) -> None:
    d.set("observations", "speed_limit_mps", None)
    d.descriptor["unrecorded"] = ["observations.speed_limit_mps"]


@empties("TAB 001 002 003 004 005")
def tables_are_gone(d: Draft) -> None:
    def remove(root: Path) -> None:
        for path in root.glob("raw/*/*.parquet"):
            path.unlink()

    d.after_seal(remove)


@empties("TAB 001 002 003 005")
def tables_are_damaged(d: Draft) -> None:
    def damage(root: Path) -> None:
        for path in root.glob("raw/*/*.parquet"):
            path.write_bytes(b"PAR0" + path.read_bytes()[4:-4] + b"PAR0")

    d.after_seal(damage)


@empties("LAY 002 003 008")
def manifest_is_no_manifest(d: Draft) -> None:
    d.edit_manifest(lambda _: "")


@empties("DOC 002 003 004 005", "ENC 001")
def descriptor_does_not_parse(d: Draft) -> None:
    d.before_seal(lambda root: (root / DESCRIPTOR_FILE).write_text(json.dumps([])[:1]))


@empties("ENC 001")
def encoding_is_not_declared(d: Draft) -> None:
    d.descriptor["action_encoding"] = None
