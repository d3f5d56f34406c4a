"""Results on a terminal: what is promised is printed where it is claimed, and figures without an interval have none."""

from __future__ import annotations

import copy
import io
import json
from pathlib import Path
from typing import Any

import pytest

from branchdrive.derive.benchmark.openings import CALIBRATION_READ
from branchdrive.derive.guard.guarantee import GLOBAL_MARGIN, GUARANTEE, LEARN_THEN_TEST
from branchdrive_reference.benchmark.text import render_results


@pytest.fixture
def results(done: Path) -> Any:
    return json.loads((done / "benchmark" / "results.json").read_bytes())


def text(results: Any) -> str:
    """The text with its lines joined."""
    return " ".join(render_results(results, io.StringIO()).split())


def test_a_refused_guard_promises_nothing(results: Any) -> None:
    """The calibration partition of the small release has four groups."""
    found = text(results)
    assert "was not judged under balanced, safety, progress, comfort: it promises nothing there." in found
    assert "Assume that" not in found
    assert GLOBAL_MARGIN in found


def test_a_judged_guard_promises_word_for_word_and_says_what_takes_from_it(results: Any) -> None:
    judged = copy.deepcopy(results)
    for profile in judged["guard"]["profiles"]:
        for method in ("conformal", "learn_then_test"):
            profile[method]["refusal"] = None
    judged["guard"]["guarantee"] |= {"conformal": GUARANTEE, "learn_then_test": LEARN_THEN_TEST}
    judged["warnings"] = [CALIBRATION_READ]
    found = text(judged)
    assert f"{CALIBRATION_READ} {GUARANTEE}" in found
    assert LEARN_THEN_TEST in found
    assert "it promises nothing" not in found


def test_the_trivial_selections_are_there_without_empty_intervals(results: Any) -> None:
    lines = render_results(results, io.StringIO()).split("\n")
    names = [line.split()[0] for line in lines[next(i for i, x in enumerate(lines) if "Guard, profile" in x) :] if line]
    assert names[2:5] == ["nominal", "action_prior", "unguarded"]
    nominal = next(line for line in lines if line.startswith("nominal") and "[" not in line)
    assert nominal.split() == ["nominal", "0.0", "0.0", "0.0", "0.000", "0.0"]


def test_repeated_nominals_are_told(results: Any) -> None:
    losses = {"num_groups": 8, "num_groups_losing": 1, "num_repeats": 16, "num_repeats_losing": 1}
    six = [0.5] * 6
    results["noise"] = {
        "tolerance": six, "rms": six, "num_groups": [8] * 6, "num_one_sided": [0] * 6, "losses": losses
    }  # fmt: skip
    assert "1 of 8 training groups (12.5 %), 1 of 16 repeats (6.2 %)" in text(results)
