"""Population, retention and leakage on a console: exact text, any width, plain ASCII."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console
from tests.validator.quality.release import DIGEST, Release, documents, leakage, paper_groups, paper_pairs

from branchdrive.cli.population import print_accesses, print_leakage, print_population, print_retention
from branchdrive.cli.text import render_build
from branchdrive.quality.ledger import with_round
from branchdrive.release.builder import BuildReport
from branchdrive.statistics.bca import LEAST_UNITS


@pytest.fixture(scope="module")
def release() -> Release:
    groups = paper_groups()
    return documents(groups, paper_pairs(groups))


def shown(printer: Any, document: Any, width: int = 110, *, terminal: bool = False) -> str:
    buffer = io.StringIO()
    console = Console(file=buffer, width=width, force_terminal=terminal, highlight=False, emoji=False)
    printer(console, document)
    return "\n".join(line.rstrip() for line in buffer.getvalue().splitlines())


def test_a_build_says_what_a_benchmark_will_lack(release: Release) -> None:
    *earlier, frozen = release.population["stages"]
    stages = [*earlier, {**frozen, "groups": {**frozen["groups"], "calibration": 50}}]

    def built(num_clusters: int) -> str:
        sizes = {"groups": 95, "clusters": num_clusters}
        made = {
            "quality/population.json": {**release.population, "stages": stages},
            "quality/split.json": {"partitions": {"test": sizes, "calibration": sizes}},
            "quality/retention.json": release.retention,
            "quality/ledger.json": with_round(None, split_digest=DIGEST, thresholds_digest=DIGEST),
        }
        return render_build(BuildReport("release", DIGEST, ("raw", "quality"), made), io.StringIO())

    few, enough = (" ".join(built(num_clusters).split()) for num_clusters in (LEAST_UNITS - 1, LEAST_UNITS))
    assert "Nothing can be concluded: `test` has 87 groups in 5 route clusters" in few
    assert "Nothing can be concluded" not in enough
    assert "guard will stay at nominal: `calibration` has 50 groups in 6 route clusters" in enough


POPULATION = """\
Population
Stage                        Train  Val  Test  Total   Traj.
------------------------------------------------------------
Discovered branch groups         -    -     -  2,467       -
Exact action banks               -    -     -  1,751  22,763
All-controls-valid banks         -    -     -    649   8,437
Integrity-complete banks       444   95    95    634   8,242
Structurally eligible banks    442   95    95    632   8,216
Core replay-valid              431   88    87    606   7,878
Extended replay-valid          427   88    85    600   7,800
------------------------------------------------------------
Frozen population              431   88    87    606   7,878
Traj. = groups x 13 candidates; not independent samples"""


@pytest.mark.parametrize("width", [80, 110])
def test_the_population_reads_like_the_table_of_the_paper(release: Release, width: int) -> None:
    assert shown(print_population, release.population, width) == POPULATION


def test_a_calibration_partition_has_its_column(release: Release) -> None:
    stages = [
        {**stage, "groups": stage["groups"] and {**stage["groups"], "calibration": 1234}}
        for stage in release.population["stages"]
    ]
    names = [*release.population["partitions"], "calibration"]
    text = shown(print_population, {**release.population, "partitions": names, "stages": stages}, 80)
    assert "Train  Val  Test  Calib.  Total   Traj." in text
    assert "431   88    87   1,234    606   7,878" in text


@pytest.mark.parametrize("width", [80, 110])
def test_retention_shows_every_row_and_says_what_was_missed(release: Release, width: int) -> None:
    lines = shown(print_retention, release.retention, width).splitlines()
    assert lines[1].split() == ["Criterion", "Partition", "Unit", "Passed", "Share", "95%", "interval", "Target"]
    (pairs,) = [line for line in lines if "1,078/1,140" in line]
    assert pairs.startswith("           test       pairs  1,078/1,140  94.56%  ")
    assert pairs.endswith("98% missed")
    assert lines[-1] == "Missed on test: 94.56% of pairs pass the core criteria, target 98%"
    assert len([line for line in lines if " pairs " in line or " banks " in line]) == 13


def test_a_retention_without_units_is_not_judged(release: Release) -> None:
    row = {**release.retention["rows"][0], "num_passed": 0, "num_units": 0, "share": None, "met": None}
    text = shown(print_retention, {**release.retention, "rows": [row]}, 80)
    assert text.splitlines()[-1].split() == ["core", "train", "pairs", "0/0", "-", "-", "98%", "not", "judged"]


def test_leakage_is_shown_with_its_effect_or_as_not_audited() -> None:
    assert shown(print_leakage, None).startswith("Leakage: not audited\n")
    lines = shown(print_leakage, leakage("inconclusive")).splitlines()
    assert lines[0] == "Leakage: inconclusive"
    assert "  Minimum detectable effect in one feature of one action: above 0.8 standard deviations." in lines


def test_accesses_are_counted(release: Release) -> None:
    assert "accessed once" in shown(print_accesses, release.ledger)
    again = with_round(release.ledger, split_digest="0" * 64, thresholds_digest=DIGEST)
    assert shown(print_accesses, again, 200).startswith("The test partition was accessed 2 times")


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("width", [80, 110])
def test_text_is_ascii_and_as_wide_as_it_may_be(release: Release, width: int, terminal: bool) -> None:
    hostile = leakage("fail", reason="[red]\x1b[2J caf\u00e9[/red] :smile:")
    for printer, document in (
        (print_population, release.population), (print_retention, release.retention), (print_leakage, hostile),
        (print_accesses, release.ledger),
    ):  # fmt: skip
        text = shown(printer, document, width, terminal=terminal)
        assert text.isascii()
        assert "\u2026" not in text
        assert "\x1b[2J" not in text
        if not terminal:
            assert max(map(len, text.splitlines())) <= width
    plain = shown(print_leakage, hostile, 200)
    assert "[red]\\x1b[2J caf\\xe9[/red] :smile:." in plain
