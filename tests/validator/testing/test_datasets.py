"""A generated dataset fails no rule, one with a defect always fails its rule, and what shrinks is easy to read."""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path

import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st
from tests.sampling import sampled

from branchdrive import Report, validate
from branchdrive.contract.rule import CATALOGUE
from branchdrive.testing import OPTIONAL_STREAMS, Defect, SmallDataset, datasets, defects
from branchdrive.testing.defect import _MAKES

NUM_EXAMPLES = settings().max_examples // 2
"""Each takes about a tenth of a second."""

ANY = settings(database=None, phases=[Phase.generate])
"""The first example that comes."""

RULES = sorted(_MAKES)


def judged(made: SmallDataset | Defect) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        return validate(made.write(Path(folder) / "dataset"))


@settings(max_examples=NUM_EXAMPLES)
@given(datasets())
def test_a_generated_dataset_fails_no_rule(dataset: SmallDataset) -> None:
    report = judged(dataset)
    assert (report.verdict, report.errors) == ("valid", ())
    assert [finding.message for finding in report.findings] == []
    assert report.funnel is not None
    assert report.funnel.lost == {}


@settings(max_examples=NUM_EXAMPLES)
@given(defects())
def test_a_defect_fails_its_rule_at_its_place(defect: Defect) -> None:
    report = judged(defect)
    assert report.errors == ()
    assert report.verdict == ("invalid" if CATALOGUE[defect.rule].decides else "valid")
    places = [finding.location for finding in report.findings if finding.rule == defect.rule]
    assert any(defect.at.items() <= place.items() for place in places), places


@pytest.mark.parametrize("rule", sampled(RULES, every=4))
def test_every_defect_can_be_asked_for(rule: str) -> None:
    dataset = datasets(streams=OPTIONAL_STREAMS[1:2], min_groups=1, max_groups=1).filter(lambda d: d.scenes[0].actors)
    defect = find(defects(dataset, rule=rule), lambda found: True, settings=ANY)
    places = [finding.location for finding in judged(defect).findings if finding.rule == rule]
    assert any(defect.at.items() <= place.items() for place in places), places


def test_a_rule_without_defects_is_named() -> None:
    with pytest.raises(ValueError, match="no defect of 'BD-ENC'"):
        find(defects(rule="BD-ENC"), lambda found: True, settings=ANY)


@pytest.mark.thorough
def test_the_smallest_dataset_is_small() -> None:
    smallest = find(datasets(), lambda dataset: True, settings=settings(database=None))
    assert len(smallest.scenes) == 1
    assert smallest.scenes[0].actors == ()
    assert len(smallest.bank.interventions) == 1
    assert smallest.streams == ()


def test_an_example_shows_what_is_wrong_and_no_table() -> None:
    defect = find(defects(rule="BD-VAL-003"), lambda found: True, settings=ANY)
    for text in (repr(defect), repr(defect.dataset)):
        assert "pyarrow" not in text
        assert len(text) < 1000
    assert "'unheard-of'" in repr(defect)


@settings(max_examples=3)
@given(st.data())
def test_equal_draws_give_equal_files(data: st.DataObject) -> None:
    dataset = data.draw(datasets(max_groups=1))
    with tempfile.TemporaryDirectory() as folder:
        roots = [dataset.write(Path(folder) / name) for name in ("one", "two")]
        again = SmallDataset(**{name: getattr(dataset, name) for name in dataset.__dataclass_fields__})
        roots.append(again.write(Path(folder) / "three"))
        first, *others = [(root / "MANIFEST.sha256").read_text() for root in roots]
    assert all(first == other for other in others)


def test_the_example_of_the_page_runs(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/testing.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        names: dict[str, object] = {"my_reader": lambda root: json.loads((root / "branchdrive.json").read_text())}
        exec(block, names)
        tests = [value for name, value in names.items() if name.startswith("test_")]
        assert tests
        for test in tests:
            settings(max_examples=3, database=None, deadline=None)(test)()  # type: ignore[operator]
