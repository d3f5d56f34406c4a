"""What scores of the paper's battery amount to."""

from __future__ import annotations

from typing import Any

import pytest

from branchdrive.leakage.parity_protocol import CONTROLS, TESTS, ParityProtocol
from branchdrive.leakage.status import judged_battery
from branchdrive.statistics.holm import holm

PROTOCOL = ParityProtocol(num_permutations=9_999)


def result(name: str, p: float | None, identical: bool = False) -> dict[str, Any]:
    if p is None:
        return {"name": name, "score": None, "training": None, "reason": "because"}
    measured = {"accuracy": 0.2, "accuracy_interval": [0.1, 0.3], "log_likelihood": -1.6, "identical": identical}
    return {"name": name, "score": {**measured, "p_accuracy": p, "p_log_likelihood": p}, "training": None}


def way(p: dict[str, float | None] | None = None, identical: str = "", num_actions: int = 5) -> dict[str, Any]:
    wanted: dict[str, float | None] = {"explicit_label": 1e-4, "synthetic_offset": 1e-4, **(p or {})}
    return {
        "name": f"{num_actions}-way",
        "num_actions": num_actions,
        "num_groups": {"train": 3, "val": 1, "test": 2},
        "controls": [result(name, wanted.get(name, 0.5)) for name in CONTROLS],
        "tests": [result(name, wanted.get(name, 0.5), name == identical) for name in TESTS],
    }


def statuses(*found: dict[str, Any], protocol: ParityProtocol = PROTOCOL) -> list[list[str]]:
    return [[test["status"] for test in way["tests"]] for way in judged_battery(found, protocol)["ways"]]


def test_nothing_found_passes_where_controls_hold() -> None:
    battery = judged_battery([way(), way(num_actions=4)], PROTOCOL)
    assert battery["trusted"]
    assert [found["chance"] for found in battery["ways"]] == [0.2, 0.25]
    assert battery["family"][:3] == [
        "5-way/availability/accuracy",
        "5-way/availability/log_likelihood",
        "5-way/discrepancy/accuracy",
    ]
    assert len(battery["family"]) == 20
    assert statuses(way(), way()) == [["pass"] * 5] * 2


def test_the_family_is_of_both_ways() -> None:
    battery = judged_battery([way({"ego": 0.003}), way({"controls": 0.0001})], PROTOCOL)
    expected = holm([0.003] * 2 + [0.0001] * 2 + [0.5] * 16)
    assert battery["ways"][0]["tests"][2]["p_adjusted"] == {"accuracy": expected[0], "log_likelihood": expected[1]}
    assert [test["status"] for test in battery["ways"][0]["tests"]] == ["pass"] * 5
    assert [test["status"] for test in battery["ways"][1]["tests"]] == ["pass"] * 3 + ["fail", "pass"]


def test_identical_scores_are_inconclusive_and_never_a_pass() -> None:
    assert statuses(way({"ego": 1.0}, identical="ego"), way())[0] == ["pass", "pass", "inconclusive", "pass", "pass"]


@pytest.mark.parametrize("p", [{"explicit_label": 0.5}, {"synthetic_offset": 0.002}, {"random_label": 0.001}])
def test_a_control_gone_astray_leaves_its_way_inconclusive(p: dict[str, float | None]) -> None:
    battery = judged_battery([way({**p, "ego": 1e-4}), way()], PROTOCOL)
    assert not battery["trusted"]
    assert [found["trusted"] for found in battery["ways"]] == [False, True]
    assert {test["status"] for test in battery["ways"][0]["tests"]} == {"inconclusive"}
    assert next(iter(p)) in battery["ways"][0]["tests"][0]["reason"]


def test_what_did_not_run_is_no_member_of_the_family() -> None:
    battery = judged_battery([way(dict.fromkeys((*CONTROLS, *TESTS))), way({"ego": None})], PROTOCOL)
    assert battery["trusted"]
    assert [found["trusted"] for found in battery["ways"]] == [None, True]
    assert len(battery["family"]) == 8
    assert [test["status"] for test in battery["ways"][0]["tests"]] == ["not_run"] * 5
    assert battery["ways"][1]["tests"][2]["status"] == "not_run"
    assert battery["ways"][1]["tests"][2]["reason"] == "because"


def test_nothing_ran_is_not_trusted() -> None:
    nothing = way(dict.fromkeys((*CONTROLS, *TESTS)))
    battery = judged_battery([nothing, nothing], PROTOCOL)
    assert (battery["trusted"], battery["family"]) == (False, [])


def test_too_few_permutations_to_fail_are_inconclusive() -> None:
    found = statuses(way(), way(), protocol=ParityProtocol(num_permutations=99))
    assert found == [["inconclusive"] * 5] * 2


def test_judging_twice_changes_nothing() -> None:
    once = judged_battery([way({"ego": 1e-4, "controls": None}), way(identical="ego")], PROTOCOL)
    assert judged_battery(once["ways"], PROTOCOL) == once
