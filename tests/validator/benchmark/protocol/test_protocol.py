"""The protocol: what the default says, what is refused, and that families keep their declared size."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.each import each
from tests.repo.checkout import ROOT
from tests.validator.contract.mutation import mutated

from branchdrive.benchmark.guard import calibration
from branchdrive.benchmark.guard.path import TOLERANCE_M
from branchdrive.benchmark.prediction.metric.metric import METRICS
from branchdrive.benchmark.prediction.metric.shuffle import SEEDS
from branchdrive.benchmark.protocol.protocol import (
    MAX_DRAWS,
    MAX_MEMBERS,
    MAX_OWNERS,
    MAX_REDRAWS,
    MAX_SHUFFLED,
    default_protocol,
    protocol_digest,
    protocol_problem,
    read_protocol,
)
from branchdrive.contract.resources import load_resource
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.driving.utility import PROFILES
from branchdrive.errors import DatasetError
from branchdrive.statistics.bca import LEVELS


def document() -> dict[str, Any]:
    return default_protocol().document


def model(found: dict[str, Any]) -> Any:
    """Configuration of M3."""
    return found["models"][3]["configuration"]


def family(name: str, *sides: tuple[str, str]) -> dict[str, Any]:
    """Tests of two models each."""
    members = [{"left": left, "right": right, "metric": "ade_m"} for left, right in sides]
    return {"name": name, "kind": "prediction", "members": members}


def large_family(size: int) -> dict[str, Any]:
    return family("large", *((f"A{i}", "B") for i in range(size)))


def of_four_models(name: str) -> dict[str, Any]:
    found = document() | {"name": name}
    del found["selection"]
    return found | {"models": found["models"][:4]}


def more_seeds(found: dict[str, Any]) -> dict[str, Any]:
    """A fifth model, of one seed."""
    return {**found["models"][0], "id": "M9", "seeds": [0], "configuration": {}}


def test_default_is_the_normative_document() -> None:
    assert document() == load_resource("benchmark-protocol.json")
    assert default_protocol().digest == protocol_digest(load_resource("benchmark-protocol.json"))


def test_default_names_what_the_formulas_compute() -> None:
    found = default_protocol()
    assert found.metrics == tuple(metric.name for metric in METRICS)
    assert found.targets == tuple(target.name for target in TARGETS)
    assert found.trajectory == TRAJECTORY
    assert list(found.preferences.items()) == list(PROFILES.items())
    assert tuple(found.shuffles.seeds) == SEEDS
    assert found.statistics.level == pytest.approx(LEVELS[1] - LEVELS[0])
    guard = found.guard
    assert (guard.alpha, guard.delta, guard.tolerance_m) == (calibration.ALPHA, calibration.DELTA, TOLERANCE_M)
    assert (guard.min_groups, guard.min_clusters) == (calibration.MIN_GROUPS, calibration.MIN_CLUSTERS)


def test_families_have_the_sizes_of_the_paper() -> None:
    sizes = {family.name: len(family.members) for family in default_protocol().families}
    assert sizes == {
        "structured": 4, "full": 9, "ranking_structured": 8, "ranking_full": 24, "ranking_near_range": 2,
        "ranking_baselines": 16, "ranking_decision": 16,
    }  # fmt: skip


def test_families_of_the_paper_are_over_its_profiles() -> None:
    """A profile of another kind enlarges no family of the paper: it has one of its own."""
    found = default_protocol()
    near = {name for name, profile in found.preferences.items() if profile.near_m is not None}
    profiles = {family.name: {m.profile for m in family.members} for family in found.of_kind("ranking")}
    assert profiles.pop("ranking_near_range") == near == {"near_range"}
    assert all(used == {"balanced", "safety", "progress", "comfort"} for used in profiles.values())


def test_a_protocol_may_do_without_outcomes_and_near_ranges() -> None:
    """As every protocol did before these parts were declared."""
    before = document() | {"name": "before"}
    del before["outcomes"], before["profiles"][-1]
    before["families"] = [family for family in before["families"] if family["name"] != "ranking_near_range"]
    found = read_protocol(before)
    assert found.outcomes is None
    assert found.document == before


@pytest.mark.parametrize("near_m", [0.0, -1.0, 1001.0, "2"])
def test_a_near_range_is_a_length(near_m: object) -> None:
    wrong = document()
    wrong["profiles"][-1]["near_m"] = near_m
    assert "near_m" in str(protocol_problem(wrong))


def test_members_of_families_have_names() -> None:
    names = [family.family.members[0] for family in default_protocol().families]
    ranked = [f"{left}.value.balanced" for left in ("O-M3-action_prior", "O-M3r-action_prior", "O-M3-action_prior")]
    further = ["O-M3-action_prior.value.near_range", "O-M3-type_prior.value.balanced"]
    assert names == ["M3-M1.macro_nmae", "M3-M1.macro_nmae", *ranked, *further]


@each(
    ("change", "words"),
    [
        (lambda d: d["models"].append(d["models"][0]), "models share a name"),
        (lambda d: d["families"].append(d["families"][0]), "families share a name"),
        (lambda d: d["profiles"][1].update(comfort=0.5), "add up to"),
        (lambda d: d["profiles"].append(d["profiles"][0]), "profiles share a name"),
        (lambda d: d["profiles"].pop(1), "families name the profiles"),
        (lambda d: d["guard"].update(model="M9"), "the guard's model 'M9' is not declared"),
        (lambda d: d["guard"].update(further_models=["M1", "M9"]), "the guard's model 'M9' is not declared"),
        (lambda d: d["guard"].update(further_models=["M3"]), "guarded models share a name: 'M3'"),
        (lambda d: d["guard"].update(further_tolerances_m=[1.0]), "/guard/further_tolerances_m"),
        (lambda d: d["guard"].update(alpha=0.2), "/guard/alpha"),
        (lambda d: d["families"][0]["members"][0].update(metric="rmse.min_ttc_s"), "/families/0"),
        (lambda d: d["partitions"].update(report="val"), "/partitions/report"),
        (lambda d: d.update(extra=1), "extra"),
        (lambda d: model(d)["model"].update(name="M2"), "the configuration of the model 'M3' has the name 'M2', not"),
        (lambda d: model(d)["model"].update(name="../../x/pwn"), "has the name '../../x/pwn'"),
        (lambda d: model(d)["model"].update(name=["M3"]), "has the name ['M3']"),
        (lambda d: model(d)["model"].update(contract="privileged"), "has the contract 'privileged', not 'sensor'"),
        (lambda d: d["models"][3].update(contract="privileged"), "has the contract 'sensor', not 'privileged'"),
        (
            lambda d: d["families"].append(family("of_one_name", ("A-B", "C"), ("A", "B-C"))),
            "share a name: 'A-B-C.ade_m'",
        ),
        (
            lambda d: d["families"].extend([family("one", ("A-B", "C")), family("other", ("A", "B-C"))]),
            "different members of families share a name",
        ),
        (lambda d: d["families"].append(large_family(MAX_MEMBERS - 78)), "have 257 members together; the limit is 256"),
        (
            lambda d: d.update(models=[*(one | {"seeds": [*range(64)]} for one in d["models"][:4]), more_seeds(d)]),
            "models have 257 seeds together; the limit is 256",
        ),
        (lambda d: d["statistics"].update(flips=20001), "/statistics/flips"),
        (lambda d: d["statistics"].update(resamples=5001), "/statistics/resamples"),
        (lambda d: d["models"][0].update(title="Mean | a cell"), "/models/0/title"),
        (lambda d: d["models"][0].update(title="Mean\n\n## Injected"), "/models/0/title"),
        (lambda d: d["models"][0].update(title="<script>alert(1)</script>"), "/models/0/title"),
        (lambda d: d["models"][0].update(title="\x1b[2JMean"), "/models/0/title"),
        (lambda d: d["models"][0].update(title="Mean\u202e"), "/models/0/title"),
        (lambda d: d["selection"]["baselines"][1].update(name="type_prior"), "'type_prior' is taken"),
        (lambda d: d["selection"]["baselines"][1].update(name="oracle"), "'oracle' is taken"),
        (lambda d: d["selection"]["baselines"][1].update(name="O-M3"), "/selection/baselines/1"),
        (lambda d: d["selection"]["baselines"][0].update(by=["regret"]), "/selection/baselines/0"),
        (lambda d: d["selection"]["baselines"][0].update(strength=0.0), "/selection/baselines/0"),
        (lambda d: d["selection"]["baselines"][3].update(contract="evaluation"), "/selection/baselines/3"),
        (lambda d: d["selection"]["references"].append("oracle"), "the reference 'oracle' is no baseline"),
    ],
)
def test_contradictions_are_refused(change: Any, words: str) -> None:
    wrong = document()
    change(wrong)
    assert words in str(protocol_problem(wrong))
    with pytest.raises(DatasetError, match="not a valid benchmark protocol"):
        read_protocol(wrong)


def test_bounds_are_reached_but_not_passed() -> None:
    large = of_four_models("large")
    large["families"].append(large_family(MAX_MEMBERS - 79))
    for one in large["models"]:
        one["seeds"] = list(range(64))
    large["statistics"] |= {"flips": 20000, "resamples": 2000}
    assert sum(len(found.members) for found in read_protocol(large).families) == MAX_MEMBERS
    assert sum(len(found.seeds) for found in read_protocol(large).models) == MAX_OWNERS


@each(
    ("resamples", "seeds", "profiles", "shuffles", "words"),
    [
        (2048, 64, 5, 20, None),
        (2049, 64, 5, 20, "256 pairs of a model and a seed have 524544 resamples together; the limit is 524288"),
        (5000, 26, 5, 20, None),
        (5000, 27, 5, 20, "108 pairs of a model and a seed have 540000 resamples together"),
        (2048, 1, 64, 20, None),
        (5000, 1, 64, 20, "4 models have under all profiles 1280000 resamples together; the limit is 524288"),
        (100, 64, 5, 21, None),
        (100, 64, 5, 22, "16896 predictions are shuffled; the limit is 16384"),
    ],
)
def test_draws_of_a_protocol_are_bounded(
    resamples: int, seeds: int, profiles: int, shuffles: int, words: str | None
) -> None:
    """Within its schema alone, a protocol could ask for hours and gigabytes."""
    large = of_four_models("large")
    for one in large["models"]:
        one["seeds"] = list(range(seeds))
    large["profiles"] += [{**large["profiles"][0], "name": f"p{i}"} for i in range(profiles - 5)]
    large["statistics"]["resamples"], large["shuffles"]["seeds"] = resamples, list(range(shuffles))
    problem = protocol_problem(large)
    assert problem == words if words is None else words in str(problem)


def test_redraws_of_guards_are_bounded() -> None:
    large = of_four_models("large")
    large["profiles"] += [{**large["profiles"][0], "name": f"p{i}"} for i in range(59)]
    assert protocol_problem(large) is None
    large["guard"]["further_models"] = ["M1"]
    assert "guards have 256000 redraws together; the limit is 131072" in str(protocol_problem(large))
    del large["guard"]["redraws"]
    assert protocol_problem(large) is None


def test_every_guarded_model_is_judged_at_every_tolerance() -> None:
    guard = document()["guard"] | {"further_models": ["M1", "M2"]}
    found = read_protocol(document() | {"name": "other", "guard": guard}).guard
    assert found.further == (("M3", 0.5), ("M1", 0.25), ("M1", 0.5), ("M2", 0.25), ("M2", 0.5))
    assert default_protocol().guard.further == (("M3", 0.5),)


def test_models_that_predict_are_bounded_as_those_that_are_declared() -> None:
    found = default_protocol()
    assert found.draws_problem(4, 262) is None
    assert "263 pairs" in str(found.draws_problem(4, 263))
    assert found.draws_problem(23, 46) is None
    assert "54 models have under all profiles" in str(found.draws_problem(24, 48))  # 6 are baselines, 24 ensembles


def test_no_other_protocol_carries_the_name_and_version_of_the_normative_one() -> None:
    other = document()
    other["statistics"]["seed"] += 1
    with pytest.raises(DatasetError, match=r"is not the protocol of that name and version; give it a name of its own"):
        read_protocol(other)
    equal = document()
    equal["models"][3]["configuration"]["training"]["max_epochs"] = 150.0
    with pytest.raises(DatasetError, match="is not the protocol of that name and version"):
        read_protocol(equal)
    for about in ({"name": "other"}, {"version": "9.0.0"}):
        assert protocol_problem(other | about) is None


def test_bounds_are_those_of_the_specification() -> None:
    chapter = (ROOT / "spec" / "14-benchmark.md").read_text("utf-8")
    assert f"MUST NOT be more than {MAX_OWNERS} pairs of a model and a seed" in chapter
    assert f"MUST each be at most {MAX_DRAWS}, and" in chapter
    assert f"seeds of shuffles at most {MAX_SHUFFLED}, for" in chapter
    assert f"`redraws` MUST be at most {MAX_REDRAWS}." in chapter
    assert f"at most {MAX_MEMBERS} members together" in chapter
    assert f"at most {MAX_OWNERS} seeds together" in chapter
    assert f"at most {MAX_MEMBERS} members together" in load_resource("protocol.schema.json")["description"]
    assert f"at most {MAX_OWNERS} seeds together" in load_resource("protocol.schema.json")["description"]


def test_a_test_may_stand_in_several_families_and_a_configuration_may_say_nothing_of_its_model() -> None:
    other = document() | {"version": "0.1.1"}
    other["families"].append({**other["families"][0], "name": "again"})
    other["models"][3]["configuration"] = {"widths": [1, 2]}
    other["models"][2]["configuration"] = {"model": "a text"}
    assert protocol_problem(other) is None


def test_what_a_protocol_fixes_is_pinned_by_the_schema() -> None:
    """They say what holds under every protocol of this version, and none can change them."""
    properties = load_resource("protocol.schema.json")["properties"]
    for name in ("metric_definitions", "targets", "trajectory", "metrics", "selectors"):
        assert properties[name] == {"const": load_resource("benchmark-protocol.json")[name]}
    assert properties["statistics"]["properties"]["level"] == {"const": 0.95}
    assert all(set(pinned) == {"const"} for pinned in properties["partitions"]["properties"].values())


@given(mutated(st.just(load_resource("benchmark-protocol.json"))))
def test_a_mutated_protocol_is_read_or_refused(changed: Any) -> None:
    try:
        found = read_protocol(changed)
    except DatasetError:
        assert protocol_problem(changed) is not None
    else:
        assert read_protocol(found.document) == found
        assert len(found.digest) == 64


def test_every_change_has_another_digest() -> None:
    changed = document()
    changed["statistics"]["seed"] = 1
    assert protocol_digest(changed) != default_protocol().digest
