"""A study as text: widths that hold, and numbers that never read as more than they are."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from tests.each import each
from tests.reference_impl.study import samples

from branchdrive.driving.utility import PROFILES
from branchdrive.text.terminal import PLAIN_WIDTH
from branchdrive_reference.study.study import Equality, Study
from branchdrive_reference.study.text import render_study

STREAM = io.StringIO()


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return samples.studied(tmp_path_factory.mktemp("study") / "dataset")


@pytest.mark.parametrize(
    ("rate", "shown"),
    [(None, "-"), (0.0, "0"), (1e-5, "<0.1"), (0.0004, "<0.1"), (0.5, "50.0"), (0.99996, ">99.9"), (1.0, "100")],
)
def test_a_share_that_is_not_quite_all_or_none_says_so(study: Study, rate: float | None, shown: str) -> None:
    text = render_study(replace(study, overall=replace(study.overall, completed=rate, clean=1.0)), io.StringIO())
    (row,) = [line for line in text.splitlines() if line.startswith("all") and len(line.split()) == 4]
    assert row.split() == ["all", "3", shown, "100" if rate in (None, 0, 1) else "100.0"]


def test_types_whose_every_rate_is_none_or_all_have_no_decimals(study: Study) -> None:
    def rows(completed: float, overall: float) -> list[list[str]]:
        types = (replace(study.scenarios[0], completed=completed, clean=1.0),)
        everything = replace(study.overall, completed=overall, clean=1.0)
        text = render_study(replace(study, scenarios=types, overall=everything), STREAM)
        lines = [line.split() for line in text.splitlines() if line.startswith(("CutIn ", "all "))]
        return [words[2:] for words in lines if len(words) == 4]

    assert rows(1.0, 1.0) == [["100", "100"], ["100", "100"]]
    assert rows(0.0, 0.5) == [["0", "100"], ["50.0", "100.0"]]
    assert rows(0.5, 1.0) == [["50.0", "100.0"], ["100.0", "100.0"]]


def test_long_names_and_many_of_them_keep_the_width(study: Study) -> None:
    names = [f"VehicleTurningRouteWithAVeryLongNameNumber{n}" for n in range(40)]
    population = replace(study.population, scenario_types=dict.fromkeys(names, 1))
    rows = tuple(replace(study.scenarios[0], scenario_type=name) for name in names)
    text = render_study(replace(study, population=population, scenarios=rows), io.StringIO())
    assert max(map(len, text.splitlines())) <= PLAIN_WIDTH
    assert text.replace("\n", "").replace(" ", "").count(names[-1]) >= 1


def test_a_terminal_gets_colour_and_its_own_width(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "72")
    monkeypatch.setenv("TERM", "xterm")
    text = render_study(study, Terminal())
    assert "\x1b[" in text
    assert "\x1b" not in render_study(study, Terminal(), is_file=True)


def test_values_missing_on_one_side_get_a_column_of_their_own(study: Study) -> None:
    spreads = [
        replace(spread, max=None, num_infinite=1) if spread.variable == "vehicle_gap_m" else spread
        for spread in study.nominal_replays
    ]
    text = render_study(replace(study, nominal_replays=tuple(spreads)), io.StringIO())
    (row,) = [line for line in text.splitlines() if line.startswith("vehicle_gap_m") and " inf " in line]
    assert row.split()[-1] == "1"
    assert "one side only" in text
    assert "one side only" not in render_study(study, io.StringIO())


@each(
    ("equality", "line"),
    [
        (Equality(1, 1, 1, {"controls": 0}), "The one compared nominal replay is bit-equal to its nominal in controls"),
        (Equality(1, 1, 0, {"controls": 1}), "1 of 1 compared nominal replay differs from its nominal: controls 1."),
        (Equality(6, 4, 2, {"controls": 2}), "2 of 4 compared nominal replays differ from their nominals: controls 2."),
        (Equality(6, 4, 4, {"controls": 0}), "2 more lack a complete nominal or are not complete."),
        (
            Equality(4, 4, 4, {"controls": 0}),
            "All 4 compared nominal replays are bit-equal to their nominals in controls.",
        ),
        (Equality(4, 4, 3, {"controls": 1, "actors": 0}), "1 of 4 compared nominal replays differs from its nominal"),
        (Equality(5, 4, 4, {"controls": 0}), "1 more lacks a complete nominal or is not complete."),
        (Equality(0, 0, 0, {"controls": 0}), "No nominal replay could be compared bit by bit with its nominal."),
    ],
)
def test_the_last_line_says_whether_replays_repeat_their_nominals(study: Study, equality: Equality, line: str) -> None:
    text = render_study(replace(study, equality=equality), io.StringIO())
    assert line in " ".join(text.split("\n\n")[-1].split())


LEFT_OUT = "integrity-complete; left out of outcomes, ranks and discrepancies"


@pytest.mark.parametrize(
    ("without_complete", "noncompliant", "line"),
    [
        (0, 0, "10, 10 integrity-complete"),
        (4, 2, f"10, 4 {LEFT_OUT} are 4 that lack a complete attempt and 2 that break a rule"),
        (1, 0, f"10, 9 {LEFT_OUT} is 1 that lacks a complete attempt"),
        (0, 1, f"10, 9 {LEFT_OUT} is 1 that breaks a rule"),
    ],
)  # fmt: skip
def test_skipped_groups_are_explained(study: Study, without_complete: int, noncompliant: int, line: str) -> None:
    population = replace(
        study.population,
        num_groups=10,
        num_integrity_complete=10 - without_complete - noncompliant,
        num_without_complete=without_complete,
        num_noncompliant=noncompliant,
    )
    text = render_study(replace(study, population=population), STREAM)
    assert f"branch groups {line} scenario types " in " ".join(text.split())


def test_ranks_are_explained_as_the_profile_weighs(study: Study) -> None:
    overall = replace(study.overall, best_collided=0.5, best_collided_in_window=0.25, num_ranked=4)
    text = " ".join(render_study(replace(study, overall=overall), STREAM).split())
    assert set(PROFILES[study.profile][:3]) == {1 / 3}
    assert f"Utility profile {study.profile}: a third each of separation, displacement and comfort over 2.5 s" in text
    assert "no judgement of safety" in text
    assert "The best candidate collides within 2.5 s in 25.0 % of 4 ranked groups, ever in 50.0 %." in text


def test_without_complete_group_one_line_says_why_there_are_no_tables(study: Study) -> None:
    text = render_study(replace(study, overall=replace(study.overall, num_groups=0)), STREAM)
    assert text.count("No outcomes: no group is integrity-complete\n") == 1
    assert "scenario type  " not in text and "Family of" not in text


def test_without_ranked_group_one_line_says_why_there_are_no_ranks(study: Study) -> None:
    text = render_study(replace(study, overall=replace(study.overall, num_ranked=0)), STREAM)
    assert text.count("No ranks: in no group every candidate has a separation\n") == 1
    assert "Drives with a collision" in text and "Family of" not in text


@pytest.mark.parametrize(
    ("num", "line"),
    [
        (0, "No nominal replay could be compared with its nominal before the branch"),
        (1, "Discrepancy before the branch of 1 nominal replay from its nominal"),
        (2, "Discrepancy before the branch of 2 nominal replays from their nominals"),
    ],
)
def test_one_is_no_plural(study: Study, num: int, line: str) -> None:
    spreads = tuple(replace(spread, num=num) for spread in study.nominal_replays)
    assert f"{line}\n" in render_study(replace(study, nominal_replays=spreads), STREAM)
