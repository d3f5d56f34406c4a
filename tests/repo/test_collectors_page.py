"""The page on collectors names what there is: methods of a world, options of a collection."""

from __future__ import annotations

import inspect
import re

from tests.repo.checkout import ROOT

import branchdrive as bd
from branchdrive.collector.group import WorldCollector

PAGE = (ROOT / "docs" / "collectors.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    table = PAGE.split(f"\n{heading}\n", 1)[1].split("\n\n", 1)[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[1:]]


def test_the_methods_are_those_of_the_protocol() -> None:
    named = [re.match(r"`(\w+)\(", row[0]) for row in rows("| method | called | says or does |")]
    methods = [name for name, _ in inspect.getmembers(bd.World, inspect.isfunction) if not name.startswith("_")]
    assert sorted(match[1] for match in named if match) == sorted(methods)
    filmed = {name for name, _ in inspect.getmembers(bd.CameraWorld, inspect.isfunction) if not name.startswith("_")}
    assert [f"`{name}()`" for name in filmed - set(methods)] == [row[0] for row in rows("| method | called | says |")]


def test_the_descriptor_of_a_world_with_views_is_one() -> None:
    (example,) = re.findall(r"```python\n(descriptor = .*?)```", PAGE, re.S)
    names = {"bd": bd}
    exec(example, names)
    assert "frames" in names["descriptor"].tables


def test_the_options_and_their_defaults_exist() -> None:
    known = {**inspect.signature(WorldCollector).parameters, **inspect.signature(bd.collect_dataset).parameters}
    table = {row[0].strip("`"): row[1] for row in rows("| option | default | meaning |")}
    assert {"trigger", "max_ticks", "num_replays", "max_attempts", "maps", "all_frames", "jobs"} == table.keys()
    for name in ("max_ticks", "num_replays", "max_attempts", "jobs"):
        assert known[name].default == int(table[name])
    assert f'brake_trigger("{WorldCollector({}).trigger.definition}")' in table["trigger"]
