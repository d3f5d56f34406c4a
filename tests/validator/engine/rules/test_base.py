"""The synthetic dataset shows every situation that rules distinguish."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from tests import synthetic, synthetic_map
from tests.scenes import ACTORS
from tests.synthetic import BRANCH_TICK, base_tables

from branchdrive.contract.columns import TABLES, table_schema
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.policy import ACTUATORS, Command


def whole(name: str) -> pa.Table:
    return pa.concat_tables([shard[name] for shard in base_tables().values()]).combine_chunks()


@pytest.mark.parametrize("name", ["rollouts", "controls", "observations", "actors", "evidence", "map", "frames"])
def test_tables_have_the_declared_schema(name: str) -> None:
    for shard in (synthetic_map.map_tables() if name == "map" else synthetic.media_tables()).values():
        assert shard[name].schema.equals(table_schema(name), check_metadata=True)


def test_descriptors_are_sound_and_claim_the_tables() -> None:
    for document, tables in (
        (synthetic.descriptor(), synthetic.base_tables()),
        (synthetic.media_descriptor(), synthetic.media_tables()),
        (synthetic_map.map_descriptor(), synthetic_map.map_tables()),
        (synthetic.bare_descriptor(), synthetic.bare_tables()),
    ):
        claimed = Descriptor.model_validate(document).tables
        assert all(tuple(shard) == claimed for shard in tables.values())


def test_generation_is_deterministic() -> None:
    assert all(rows.equals(base_tables()["raw/shard-00001"][name]) for name, rows in synthetic.make_group(2).items())


def test_every_class_of_actor_is_there() -> None:
    assert set(whole("actors")["actor_class"].to_pylist()) == set(TABLES["actors"]["actor_class"].values)


def test_every_mask_is_sometimes_on_and_sometimes_off() -> None:
    evidence = whole("evidence")
    masks = [
        column.available.mask for column in TABLES["evidence"].columns if column.available and column.available.mask
    ]
    assert masks
    for mask in masks:
        assert set(evidence[mask].to_pylist()) == {True, False}, mask


def test_frames_show_closing_parting_overlap_and_solitude() -> None:
    evidence = whole("evidence")
    seen, closing = (evidence[f"{name}_available"].to_numpy() for name in ("separation", "ttc"))
    assert (seen & ~closing).any()
    assert (~seen & (evidence["num_actors"].to_numpy() > 0)).any()
    assert pc.min(evidence["separation_m"]).as_py() == 0
    assert pc.min(evidence["ttc_s"]).as_py() == 0
    speeds = evidence["nearest_vehicle_rel_speed_mps"].drop_null().to_numpy()
    assert speeds.min() < -1 < 1 < speeds.max()


def test_static_objects_count_inside_the_corridor_alone() -> None:
    evidence = whole("evidence").filter(pc.equal(whole("evidence")["rollout_id"], "g2.nominal.a1"))
    kinds = {actor_id: actor.kind for actor_id, actor in enumerate(ACTORS[2], start=1)}
    assert "static" in {kinds[actor_id] for actor_id in evidence["separation_actor_id"].drop_null().to_pylist()}
    lonely = evidence.filter(pc.less(evidence["tick"], 60))
    assert lonely["num_actors"].to_pylist() == [1] * 12
    assert not any(lonely["separation_available"].to_pylist())


def test_every_actuator_rule_is_exercised_with_an_effect() -> None:
    controls = whole("controls")
    active = controls.filter(controls["active"])
    differs = [
        np.asarray(active[f"applied_{actuator}"]) != np.asarray(active[f"expert_{actuator}"]) for actuator in ACTUATORS
    ]
    assert all(column.any() for column in differs)


def test_commands_agree_with_the_algebra_of_the_library() -> None:
    """Two independent implementations of the five rules."""
    bank = Descriptor.model_validate(synthetic.descriptor()).action_bank
    controls = whole("controls")
    for policy in bank.interventions:
        rows = controls.filter(pc.and_(controls["active"], pc.equal(controls["rollout_id"], f"g1.{policy.key}.a1")))
        expert, stored, intended = (
            Command(*(np.asarray(rows[f"{kind}_{actuator}"]) for actuator in ACTUATORS))
            for kind in ("expert", "nominal", "intended")
        )
        assert rows["tick"].to_pylist() == list(range(BRANCH_TICK, BRANCH_TICK + 50))
        for demanded, recorded in zip(policy.command(expert, stored), intended, strict=True):
            assert np.array_equal(demanded, recorded)


def test_shared_tables_survive_drafts() -> None:
    from tests.mutation import new_draft

    before = base_tables()["raw/shard-00000"]["controls"]
    draft = new_draft()
    draft.set("controls", "applied_steer", 0.5, rollout_id="g0.nominal.a1", tick=3)
    assert base_tables()["raw/shard-00000"]["controls"] is before
    assert draft.tables["raw/shard-00000"]["controls"] is not before
    with pytest.raises(AssertionError, match="no row"):
        draft.set("controls", "applied_steer", 0.5, rollout_id="g0.nominal.a9")
