"""The protocol: what the default says, what is refused, and that families keep their declared size."""

from __future__ import annotations

from typing import Any

import pytest

from branchdrive.contract.resources import load_resource
from branchdrive.derive.benchmark.protocol import default_protocol, protocol_digest, protocol_problem, read_protocol
from branchdrive.derive.guard import calibration
from branchdrive.derive.guard.path import TOLERANCE_M
from branchdrive.derive.metric.interval import LEVELS
from branchdrive.derive.metric.metric import METRICS
from branchdrive.derive.metric.shuffle import SEEDS
from branchdrive.derive.target import TARGETS, TRAJECTORY
from branchdrive.derive.utility import PROFILES
from branchdrive.errors import DatasetError


def document() -> dict[str, Any]:
    return default_protocol().document


def test_default_is_the_normative_document() -> None:
    assert document() == load_resource("benchmark-protocol.json")
    assert protocol_digest(default_protocol()) == protocol_digest(load_resource("benchmark-protocol.json"))


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
    assert sizes == {"structured": 4, "full": 9, "ranking_structured": 8, "ranking_full": 24}


def test_members_of_families_have_names() -> None:
    names = [family.family.members[0] for family in default_protocol().families]
    assert names == ["M3-M1.macro_nmae", "M3-M1.macro_nmae", *["O-M3-action_prior.value.balanced"] * 2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["models"].append(d["models"][0]), "models share a name"),
        (lambda d: d["families"].append(d["families"][0]), "families share a name"),
        (lambda d: d["profiles"][1].update(comfort=0.5), "add up to"),
        (lambda d: d["profiles"].append(d["profiles"][0]), "profiles share a name"),
        (lambda d: d["profiles"].pop(1), "families name the profiles"),
        (lambda d: d["guard"].update(model="M9"), "the guard's model 'M9' is not declared"),
        (lambda d: d["guard"].update(alpha=0.2), "/guard/alpha"),
        (lambda d: d["families"][0]["members"][0].update(metric="rmse.min_ttc_s"), "/families/0"),
        (lambda d: d["partitions"].update(report="val"), "/partitions/report"),
        (lambda d: d.update(extra=1), "extra"),
    ],
)
def test_contradictions_are_refused(change: Any, words: str) -> None:
    wrong = document()
    change(wrong)
    assert words in str(protocol_problem(wrong))
    with pytest.raises(DatasetError, match="no benchmark protocol"):
        read_protocol(wrong)


def test_every_change_has_another_digest() -> None:
    changed = document()
    changed["statistics"]["seed"] = 1
    assert protocol_digest(changed) != protocol_digest(default_protocol())
