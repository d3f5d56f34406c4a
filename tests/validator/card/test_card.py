"""The dataset card: what the documents say, what must not be concluded, and text that stays text."""

from __future__ import annotations

import re
from typing import Any

import pytest
from tests.each import each
from tests.validator.contract.layer_documents import EXAMPLES
from tests.validator.quality.release import (
    DIGEST,
    ONES,
    Release,
    concat,
    documents,
    leakage,
    numbered,
    pairs_of,
    paper_groups,
    paper_pairs,
    reaching,
)
from tests.validator.writer.invented import make_descriptor

from branchdrive.card.card import render_card
from branchdrive.card.licence import render_licence
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import LAYERS, table_pattern
from branchdrive.quality.fidelity import with_passes
from branchdrive.quality.ledger import with_round
from branchdrive.quality.text import filtering_sentences
from branchdrive.quality.variants import declared_variants, variants_document

DISPOSITIONS = next(c.values for c in LAYER_TABLES["attempts"].columns if c.name == "disposition")
SOURCE = {
    "spec_version": "0.1", "raw_layer": DIGEST, "dataset_id": "d", "dataset_version": "0.1.0",
    "num_groups": 2467, "num_attempts": 24116,
    "records": {"physical": 22312, "nominal_link": 1820, "missing": 7939},
    "states": {"selected": 21000, "ineligible": 3132, "missing": 7939},
    "dispositions": {name: 100 + i for i, name in enumerate(DISPOSITIONS)},
}  # fmt: skip


@pytest.fixture(scope="module")
def release() -> Release:
    groups = paper_groups()
    return documents(groups, paper_pairs(groups))


def card(release: Release, leaks: Any = None, layers: tuple[str, ...] = ("raw", *LAYERS), **about: Any) -> str:
    described = make_descriptor().model_copy(update={"layers": layers, **about})
    return render_card(described, SOURCE, *release, leakage=leaks)


def body(text: str) -> str:
    """A card without its front matter."""
    return text.split("\n---\n\n", 1)[1]


def row(text: str, head: str) -> list[str]:
    """Cells of the table row whose first cell is `head`, emphasis removed."""
    (line,) = [line for line in text.splitlines() if line.replace("*", "").startswith(f"| {head} |")]
    return [cell.strip().strip("*") for cell in line.strip("|").split(" | ")][1:]


@pytest.mark.parametrize(
    ("stage", "cells"),
    [
        ("Discovered branch groups", ["-", "-", "-", "2,467", "-"]),
        ("Exact action banks", ["-", "-", "-", "1,751", "22,763"]),
        ("All-controls-valid banks", ["-", "-", "-", "649", "8,437"]),
        ("Integrity-complete banks", ["444", "95", "95", "634", "8,242"]),
        ("Core replay-valid", ["431", "88", "87", "606", "7,878"]),
        ("Extended replay-valid", ["427", "88", "85", "600", "7,800"]),
        ("Frozen population", ["431", "88", "87", "606", "7,878"]),
    ],
)
def test_the_population_is_the_table_of_the_paper(release: Release, stage: str, cells: list[str]) -> None:
    assert [cell.strip() for cell in row(card(release), stage)] == cells


def test_the_largest_loss_is_named(release: Release) -> None:
    expected = "The largest loss is of 1,102 groups, from *exact action banks* to *all-controls-valid banks*."
    assert expected in card(release)


def test_a_calibration_partition_has_its_column() -> None:
    parts = [reaching(name, 6, 3, name) for name in ("train", "val", "test", "calibration")]
    groups = numbered(concat(parts))
    text = card(documents(groups, with_passes(pairs_of(groups), ONES)))
    assert row(text, "Stage or population") == ["Train", "Validation", "Test", "Calibration", "Total groups", "Traj."]
    assert row(text, "Frozen population") == ["3", "3", "3", "3", "12", "156"]
    assert "The largest loss" not in text


def test_the_card_says_whether_calibration_was_a_uniform_draw() -> None:
    parts = [reaching(name, 6, 3, name) for name in ("train", "val", "test", "calibration")]
    found = documents(groups := numbered(concat(parts)), with_passes(pairs_of(groups), ONES))
    assumed = "drawn by `clustered-1`: that its clusters and those of test are exchangeable is assumed."
    assert assumed in card(found)
    divided = card(found._replace(split={**found.split, "algorithm": "clustered-2"}))
    assert "are exchangeable by construction" in divided
    assert assumed not in divided


def test_every_disposition_is_counted_and_explained(release: Release) -> None:
    text = card(release)
    for name in DISPOSITIONS:
        count, meaning = row(text, f"`{name}`")
        assert count == str(SOURCE["dispositions"][name])  # type: ignore[index]
        assert meaning
    assert "24,116 attempts of 2,467 groups" in text
    assert "32,071 canonical records" in text


def test_a_missed_target_is_said_plainly(release: Release) -> None:
    text = card(release)
    assert "| core | Test | pairs | 1,078 of 1,140 | 94.56% |" in text
    assert "98%, **not met** |" in text
    assert (
        "On the test partition 1,078 of 1,140 pairs passed, 94.56%: the predeclared target of 98% was not met." in text
    )


def test_thresholds_are_listed_and_an_unjudged_one_says_so(release: Release) -> None:
    text = card(release)
    assert row(text, "`position_m`") == ["core", "9 m"]
    assert row(text, "`pedestrian_gap_m`") == ["extended", "not judged: support of 0 groups"]
    variables = [{**v, "value": None} if v["name"] == "vehicle_gap_m" else v for v in release.thresholds["variables"]]
    unbounded = release._replace(thresholds={**release.thresholds, "variables": variables})
    assert row(card(unbounded), "`vehicle_gap_m`") == ["extended", "any finite value"]


def test_thresholds_that_filter_nothing_are_named_where_that_is_known(release: Release) -> None:
    described = make_descriptor().model_copy(update={"layers": ("raw", *LAYERS)})
    filtering = EXAMPLES["filtering"]
    text = render_card(described, SOURCE, *release, filtering=filtering)
    assert all(sentence in text for sentence in filtering_sentences(filtering))
    assert row(text, "`matched_vehicle_gap_m`") == ["0.25", "0.5", "50.00%", "100.00%", "12", "-", "decides nothing"]
    assert "filters nothing" not in card(release)
    assert "filtering.json" not in card(release)


def test_a_retention_without_units_is_no_pass(release: Release) -> None:
    nothing = {"num_groups": 0, "num_passed": 0, "num_units": 0, "share": None, "low": None, "high": None, "met": None}
    rows = [{**r, **nothing} for r in release.retention["rows"]]
    text = card(release._replace(retention={**release.retention, "rows": rows}))
    assert "| core | Test | pairs | 0 of 0 | - | - | 98%, not judged |" in text
    assert "On the test partition" not in text


def test_leakage_is_told_or_said_to_be_unknown(release: Release) -> None:
    assert "Leakage was not audited" in card(release)
    assert "quality/leakage.json" not in card(release)
    text = card(release, leakage())
    assert "The leakage gate passes" in text
    assert "Minimum detectable effect" in text
    assert "quality/leakage.json" in text


def test_warnings_stand_on_top(release: Release) -> None:
    assert "Warning" not in card(release, leakage())
    again = with_round(release.ledger, split_digest="0" * 64, thresholds_digest=DIGEST)
    top = card(release._replace(ledger=again), leakage("fail")).split("\n\n")[2:4]
    assert top[0].startswith("> **Warning.** The test partition was accessed 2 times")
    assert top[1].startswith("> **Warning.** The leakage gate fails")


@each(
    "claim",
    [
        "No closed-loop claim", "The best candidate is not the best action", "Trajectories are not independent samples",
        "No binary safety labels", "An unavailable time to collision is not a safe one",
        "Matched replays are not restored states", "Privileged inputs are not sensors", "One simulator's traffic",
        "The horizon is 2.5 s", "No leakage found is not no leakage",
    ],
)  # fmt: skip
def test_what_must_not_be_concluded_is_in_every_card(release: Release, claim: str) -> None:
    assert f"- **{claim}.** " in card(release)


def test_variants_stand_apart(release: Release) -> None:
    declared = declared_variants([{"name": "lost", "title": "a | b", "where": {"exact_bank": False, "lost": True}}])
    groups = paper_groups()
    groups["lost"] = ~groups["eligible"]
    text = card(release._replace(variants=variants_document(groups, declared)))
    assert "| `lost` | a \\| b | not `exact_bank`, `lost` | 716 |" in text
    assert f"606 groups, digest `{release.variants['frozen']['digest']}`" in text


def test_the_files_of_every_layer_are_described(release: Release) -> None:
    described = make_descriptor().model_copy(update={"layers": ("raw", *LAYERS)})
    added = {"leakage": leakage(), "filtering": EXAMPLES["filtering"]}
    text = render_card(described, SOURCE, *release, **added, optional=["endings", "objects"])
    for layer in LAYERS.values():
        names = [*(f"{layer.name}/{name}" for name in layer.documents), *map(table_pattern, layer.tables)]
        for name in names if layer.name != "benchmark" else ():
            assert row(text, f"`{name}`".replace("*", ""))[0]
    assert "`raw/`" in text
    assert "--raw" not in text


def test_an_optional_table_is_described_where_it_is_there(release: Release) -> None:
    assert "endings" not in card(release)


def test_a_detached_release_names_its_raw_layer(release: Release) -> None:
    text = card(release, layers=tuple(LAYERS))
    assert "`raw/`" not in text
    assert f"detached from its raw layer, whose digest is `{DIGEST}`" in text
    assert "branchdrive-validate PATH --raw RAW" in text


def test_layers_that_are_not_claimed_are_not_described(release: Release) -> None:
    assert "model/" not in card(release, layers=("raw", "canonical", "quality"))


def test_the_same_documents_give_the_same_bytes(release: Release) -> None:
    text = card(release, leakage())
    assert text == card(release, leakage())
    assert text.endswith("\n")
    assert not text.endswith("\n\n")
    assert "\n\n\n" not in text
    assert not re.search(r"\b20[0-9]{2}-[0-9]{2}-[0-9]{2}\b", text)


def test_every_table_has_as_many_cells_in_each_row(release: Release) -> None:
    for block in card(release, leakage()).split("\n\n"):
        lines = [line for line in block.splitlines() if line.startswith("|")]
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) <= 1


@pytest.mark.parametrize(
    "title", ["a\n# b", "a\r\n> b", "<script>x</script>", "![x](y)", "`a` | *b* \x1b[31m", "[a]: b"]
)
def test_free_text_stays_text(release: Release, title: str) -> None:
    head, rest = body(card(release, title=title)).split("\n", 1)
    assert head.startswith("# ")
    assert head.isprintable()
    assert not re.search(r"(?<!\\)[<>\[\]`*|!]", head)
    assert rest == body(card(release)).split("\n", 1)[1]


def test_what_the_descriptor_states_is_repeated_as_text(release: Release) -> None:
    stated = {
        "description": "Cuts in, *mostly*.",
        "creators": ("A. Author", "Institute | North"),
        "citation": "Author, Driving, 2026.",
        "doi": "10.1234/branch",
        "url": "https://example.org/data",
        "keywords": ("driving", "branches"),
    }
    silent, text = card(release), card(release, **stated)
    assert "Cuts in, \\*mostly\\*." in text
    for title in ("Creators", "Citation", "DOI", "Published at", "Keywords"):
        assert f"| {title} |" in text
        assert f"| {title} |" not in silent
    assert row(text, "Keywords") == ["driving, branches"]
    assert "Institute \\| North" in text


def test_a_licence_of_the_spdx_list_says_where_its_text_is() -> None:
    text = render_licence("CC-BY-4.0")
    assert text.startswith("SPDX-License-Identifier: CC-BY-4.0\n")
    assert "https://spdx.org/licenses/CC-BY-4.0.html" in text
    assert "may be under another licence" in text


def test_an_expression_names_every_licence_once() -> None:
    text = render_licence("MIT OR GPL-2.0-only WITH Classpath-exception-2.0 OR MIT")
    places = re.findall(r"licenses/(.*)\.html", text)
    assert places == ["MIT", "GPL-2.0-only", "Classpath-exception-2.0"]


@pytest.mark.parametrize("name", ["CC BY 4.0", "LicenseRef-mine", "Our own licence", "MIT OR"])
def test_another_licence_is_not_given_an_address(name: str) -> None:
    text = render_licence(name)
    assert text.startswith(f"Licence: {name}\n")
    assert "spdx.org" not in text
    assert "ask the publisher" in text
