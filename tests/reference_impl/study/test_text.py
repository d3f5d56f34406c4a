"""A study as text: widths that hold, and numbers that never read as more than they are."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from tests.reference_impl.study import samples
from tests.synthetic import group_name

from branchdrive_reference.study.study import Equality, Study
from branchdrive_reference.study.text import render_study


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return samples.studied(tmp_path_factory.mktemp("study") / "dataset")


@pytest.mark.parametrize(
    ("rate", "shown"),
    [(None, "-"), (0.0, "0.0"), (1e-5, "<0.1"), (0.0004, "<0.1"), (0.5, "50.0"), (0.99996, ">99.9"), (1.0, "100.0")],
)
def test_a_share_that_is_not_quite_all_or_none_says_so(study: Study, rate: float | None, shown: str) -> None:
    text = render_study(replace(study, overall=replace(study.overall, completed=rate)), io.StringIO())
    (row,) = [line for line in text.splitlines() if line.startswith("all") and len(line.split()) == 4]
    assert row.split() == ["all", "3", shown, "100.0"]


def test_long_names_and_many_of_them_keep_the_width(study: Study) -> None:
    names = [f"VehicleTurningRouteWithAVeryLongNameNumber{n}" for n in range(40)]
    population = replace(study.population, scenario_types=dict.fromkeys(names, 1))
    rows = tuple(replace(study.scenarios[0], scenario_type=name) for name in names)
    text = render_study(replace(study, population=population, scenarios=rows), io.StringIO())
    assert max(map(len, text.splitlines())) <= 100
    assert text.replace("\n", "").replace(" ", "").count(names[-1]) >= 1


def test_a_terminal_gets_colour_and_its_own_width(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "72")
    monkeypatch.setenv("TERM", "xterm")
    text = render_study(study, Terminal())
    assert "\x1b[" in text
    assert "\x1b" not in render_study(study, Terminal(), is_file=True)


def test_values_missing_on_one_side_get_a_column_of_their_own(tmp_path: Path, study: Study) -> None:
    replay = f"{group_name(0)}.nominal_replay.a1"
    hidden = {"evidence": samples.replaced("nearest_vehicle_available", {replay: False})}
    text = render_study(samples.studied(tmp_path / "dataset", hidden), io.StringIO())
    (row,) = [line for line in text.splitlines() if line.startswith("vehicle_gap_m") and " inf " in line]
    assert row.split()[-1] == "1"
    assert "one side only" in text
    assert "one side only" not in render_study(study, io.StringIO())


@pytest.mark.parametrize(
    ("equality", "line"),
    [
        (
            Equality(4, 4, 4, {"controls": 0}),
            "All 4 compared nominal replays are bit-equal to their nominals in controls.",
        ),
        (Equality(4, 4, 3, {"controls": 1, "actors": 0}), "1 of 4 compared nominal replays differ"),
        (Equality(5, 4, 4, {"controls": 0}), "1 more lack a complete nominal or are not complete."),
        (Equality(0, 0, 0, {"controls": 0}), "No nominal replay could be compared bit by bit with its nominal."),
    ],
)
def test_the_last_line_says_whether_replays_repeat_their_nominals(study: Study, equality: Equality, line: str) -> None:
    text = render_study(replace(study, equality=equality), io.StringIO())
    assert line in " ".join(text.split("\n\n")[-1].split())
