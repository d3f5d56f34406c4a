"""Pilots of five worlds: each says nothing of a right collector that is not so, and names every planted mistake.

A mistake is named where a concern has its words, which say which way it goes, and a remedy that undoes it; whatever
else is said then must be said of the right collector, too, or follow from the mistake.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.sampling import THOROUGH
from tests.validator.collector.straight import EmptyRoad, ShortRoad
from tests.validator.collector.straight import descriptor as straight_descriptor
from tests.validator.pilot import mistakes
from tests.validator.pilot.mistakes import Planted
from tests.validator.pilot.worlds import WORLDS, Source, collect

import branchdrive as bd
from branchdrive.pilot.conformance import conformance
from branchdrive.pilot.pilot import read_pilot
from branchdrive.pilot.report import PilotReport, examine_pilot


class Named(NamedTuple):
    """How a mistake is named.

    Attributes:
        section: Section of the concern.
        words: Pattern of what it says is wrong.
        remedy: Words of what it says is to be done.
    """

    section: str
    words: str
    remedy: str


_OBSERVE_FIRST = "before the command of t is applied"

MISTAKES: dict[type[Planted], Named] = {
    mistakes.SpeedInKmh: Named("physics", r"of the ego: speed_mps is in km/h", "divide by 3.6"),
    mistakes.ActorsInKmh: Named("physics", r"of vehicles.* vel_x_mps and vel_y_mps are in km/h", "divide by 3.6"),
    mistakes.MirroredSteering: Named("physics", r"applied_steer acts in the contrary direction", "negate the steering"),
    mistakes.LateCommands: Named("response", r"come late, by about 1(\.5)? ticks? ", "in the step from t"),
    mistakes.EarlyByATick: Named("response", r"before their commands, by about 1 tick ", _OBSERVE_FIRST),
    mistakes.HalfExtents: Named("physics", r"these are half extents", "twice the half extents"),
    mistakes.Degrees: Named("physics", r"Headings \(yaw_rad\) of the ego.* are in degrees", "pi / 180"),
    mistakes.Compass: Named("physics", r"clockwise from the y axis, as a compass has it", "pi / 2 minus it"),
    mistakes.MirroredHeading: Named("physics", r"Headings \(yaw_rad\) of the ego.* are clockwise:", "negate it"),
    mistakes.MirroredWorld: Named("physics", r"the world is mirrored, or steering", "negate y, yaw, yaw rate"),
    mistakes.SwappedPedals: Named("physics", r"applied_throttle acts in the contrary direction", "throttle is"),
    mistakes.LateObservations: Named("response", r"by about 5 ticks .*: observations are late", _OBSERVE_FIRST),
    mistakes.LateByATick: Named("response", r"come late, by about 1(\.5)? ticks? .* are late,", _OBSERVE_FIRST),
    mistakes.EarlyObservations: Named("response", r"before their commands, by about 5 ticks ", _OBSERVE_FIRST),
    mistakes.RearAxle: Named("physics", r"that of the rear axle|behind the point that does not slip", "box_centre"),
    mistakes.YawRateSign: Named("physics", r"yaw_rate_radps has the contrary sign.*yaw rate is clockwise", "negate it"),
    mistakes.YawRateInDegrees: Named("physics", r"yaw_rate_radps .* in degrees per second", "pi / 180"),
    mistakes.KeptState: Named("replay", r"keeps something from one rollout to the next", "Find what is kept"),
    mistakes.IgnoredCommands: Named("response", r"The commands of .* are ignored", "Apply the policy's command"),
    mistakes.LongTicks: Named("physics", r"recorded tick is 0\.052[56] s of the simulator, 19", "by 0.05 s for every"),
    mistakes.TenHertz: Named("physics", r"tick is 0\.1 s of the simulator, (10|9\.99) Hz", "by 0.05 s for every"),
    mistakes.ConstantTarget: Named("columns", r"target_speed_mps is the same in every row: 10", "`unrecorded`"),
}  # fmt: skip

UNSHOWN = "No mean effect is shown"
"""Said of policies whose effects a few groups leave open; which these are differs with what is recorded."""

CONSEQUENCES = ("conformance", "funnel", "routes")
"""Sections whose concerns follow from a mistake: rules that fail, groups that are lost."""

QUICK = {
    "minimal": (),
    "template": (),
    "short": (mistakes.SpeedInKmh, mistakes.EarlyByATick, mistakes.IgnoredCommands),
}  # fmt: skip
"""Worlds that `make test` collects, and mistakes that it plants into them."""


Right = Callable[[str], PilotReport]


def examined(root: Path) -> PilotReport:
    return examine_pilot(read_pilot(root), None, num_kills=1)


def source_of(world: str) -> Source:
    source = WORLDS[world]
    if source.needs:
        pytest.importorskip(source.needs, reason=f"{source.needs} is not installed: pip install -e '.[examples]'")
    return source


@pytest.fixture(scope="session")
def right(tmp_path_factory: pytest.TempPathFactory) -> Right:
    """The report on the right collector of a world, by its name."""

    @cache
    def report(world: str) -> PilotReport:
        return examined(collect(tmp_path_factory.mktemp(world) / "dataset", source_of(world)))

    return report


def said(report: PilotReport) -> Iterator[tuple[str, str, str]]:
    """Section, what is wrong, and what is to be done, of every concern."""
    return ((section.name, concern.what, concern.remedy) for section, concern in report.concerns)


def without_numbers(text: str) -> str:
    return re.sub(r"[-+]?[0-9][0-9.,]*", "#", text)


@pytest.mark.parametrize("world", [pytest.param(w, marks=() if w in QUICK else THOROUGH) for w in WORLDS])
def test_a_right_collector_has_no_problem_but_few_routes(world: str, right: Right) -> None:
    report = right(world)
    assert report.pilot.report.verdict == "valid"
    allowed = WORLDS[world].problems
    assert {section.name for section, concern in report.concerns if concern.is_problem} <= allowed
    concerned = {section.name for section, _ in report.concerns}
    assert not concerned & ({"conformance", "columns", "replay"} - allowed)
    assert not [what for name, what, _ in said(report) if name == "response" and what.startswith("Effects come")]
    if world == "template":
        assert "routes" not in concerned


@pytest.mark.parametrize(
    ("world", "mistake"),
    [
        pytest.param(w, m, marks=() if m in QUICK.get(w, ()) else THOROUGH, id=f"{w}-{m.__name__}")
        for w, source in WORLDS.items()
        for m in MISTAKES
        if m.__name__ not in source.unshown
    ],
)
def test_a_planted_mistake_is_named_and_nothing_else(
    world: str, mistake: type[Planted], right: Right, tmp_path: Path
) -> None:
    report = examined(collect(tmp_path / "dataset", source_of(world), mistake))
    section, words, remedy = MISTAKES[mistake]
    named = [(what, do) for name, what, do in said(report) if name == section and re.search(words, what)]
    assert len(named) == 1, list(said(report))
    assert remedy in named[0][1]
    known = {without_numbers(what) for _, what, _ in said(right(world))}
    others = [
        (name, what)
        for name, what, _ in said(report)
        if name not in CONSEQUENCES
        and what != named[0][0]
        and without_numbers(what) not in known
        and not what.startswith(UNSHOWN)
    ]
    assert others == []
    results = {section.name: section.result for section in report.sections}
    assert (results["conformance"] == "problem") >= (report.pilot.report.verdict == "invalid")


def test_a_seed_without_a_branch_is_no_concern_of_conformance(tmp_path: Path) -> None:
    worlds = {"Parked Car": ShortRoad, "Empty": EmptyRoad}
    bd.collect_dataset(tmp_path / "dataset", straight_descriptor(), worlds, num_groups=2)
    section = conformance(read_pilot(tmp_path / "dataset"), [])
    assert section.concerns == []
    assert any("1 group without a branch, which the funnel counts" in fact for fact in section.facts)


def test_a_pilot_in_which_nothing_happens_is_reported_on(tmp_path: Path) -> None:
    """No group has a branch, so that nobody's way can be compared."""
    bd.collect_dataset(tmp_path / "dataset", straight_descriptor(), {"Empty": EmptyRoad}, num_groups=1)
    report = examined(tmp_path / "dataset")
    assert [section.name for section, concern in report.concerns if concern.is_problem] == ["funnel"]
