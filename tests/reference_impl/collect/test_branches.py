"""A collection with early and quiet branches is valid, its groups qualify, and a study counts its kinds."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.content_cache import kept_folder

from branchdrive import validate
from branchdrive.raw.reader import open_dataset
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.collect.plan import plan_group
from branchdrive_reference.study.survey import study_dataset

BRANCHES = {"early": 0.5, "quiet": 0.5}
SCENARIO = "StaticCutIn"
SEED = next(seed for seed in range(100) if [plan_group(seed, i, (), BRANCHES).kind for i in (0, 1)] == [*BRANCHES])


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    def collected(folder: Path) -> None:
        collect(folder, num_groups=2, seed=SEED, branches=BRANCHES, scenario_types=[SCENARIO])

    return kept_folder("collected-branches", collected, tmp_path_factory.mktemp("collected") / "dataset")


def test_it_is_valid_and_every_group_qualifies(root: Path) -> None:
    report = validate(root)
    assert report.verdict == "valid"
    assert report.funnel is not None
    assert report.funnel.qualified == 2


def test_the_descriptor_declares_the_shares(root: Path) -> None:
    assert open_dataset(root).descriptor.collection.branches == BRANCHES


def test_a_study_counts_the_kinds(root: Path) -> None:
    study = study_dataset(root, lambda *_: None)
    assert study.population.branches == {"early": 1, "quiet": 1}
    assert [(row.scenario_type, row.num_groups) for row in study.branches] == [("early", 1), ("quiet", 1)]
