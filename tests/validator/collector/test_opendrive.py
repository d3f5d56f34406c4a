"""Maps from OpenDRIVE files: places of lanes against what curves are, and against a library that we did not write."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import fresnel
from tests.validator.collector.straight import ShortRoad, few_policies

import branchdrive as bd
from branchdrive.collector import opendrive
from branchdrive.collector.reference_line import Cubic, clothoid, cubic_by_length, parametric_cubic

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'
DRIVING = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
RIGHT = f"<right>{DRIVING.format(-1)}</right>"


def section(sides: str, s: float = 0.0) -> str:
    return f'<laneSection s="{s}">{sides}</laneSection>'


def road(
    plan: str = LINE, lanes: str = section(RIGHT), rest: str = "", *, length: float = 100.0, name: str = "1",
    more: str = "",
) -> str:  # fmt: skip
    body = f"<planView>{plan}</planView><lanes>{lanes}</lanes>{rest}"
    return f'<road id="{name}" length="{length}" junction="-1" {more}>{body}</road>'


def read(tmp_path: Path, *roads: str, step_m: float = 1.0) -> list[dict[str, Any]]:
    path = tmp_path / "town.xodr"
    path.write_text(f'<?xml version="1.0"?><OpenDRIVE>{"".join(roads)}</OpenDRIVE>')
    return bd.read_opendrive(path, step_m=step_m)


def only(elements: list[dict[str, Any]], kind: str = "lane") -> dict[str, Any]:
    (found,) = (element for element in elements if element["kind"] == kind)
    return found


def points(element: dict[str, Any]) -> NDArray[np.float64]:
    return np.stack([element["x_m"], element["y_m"]], axis=1)


def test_a_straight_road_has_lanes_of_two_vertices_in_driving_order(tmp_path: Path) -> None:
    both = section(f"<left>{DRIVING.format(1)}</left>{RIGHT}")
    left, right = read(tmp_path, road(LINE, both))
    assert (left["lane_id"], right["lane_id"]) == ("1.0.1", "1.0.-1")
    assert np.allclose(points(left), [[100, 1.75], [0, 1.75]])
    assert np.allclose(points(right), [[0, -1.75], [100, -1.75]])
    assert right["width_m"].tolist() == [3.5, 3.5]


@pytest.mark.parametrize(
    ("rule", "attribute", "runs_back"),
    [
        ("RHT", "", False), ("LHT", "", True), ("RHT", 'direction="reversed"', True),
        ("LHT", 'direction="reversed"', False),
    ],
)  # fmt: skip
def test_the_side_and_the_direction_of_a_lane_say_how_it_is_driven(
    tmp_path: Path, rule: str, attribute: str, runs_back: bool
) -> None:
    lanes = section(RIGHT.replace('type="driving"', f'type="driving" {attribute}'))
    lane = only(read(tmp_path, road(LINE, lanes, more=f'rule="{rule}"')))
    assert (lane["x_m"][0] > lane["x_m"][-1]) == runs_back


@pytest.mark.parametrize("curvature", [0.02, -0.02])
def test_lanes_of_an_arc_lie_on_circles(tmp_path: Path, curvature: float) -> None:
    plan = f'<geometry s="0" x="3" y="-4" hdg="0.7" length="100"><arc curvature="{curvature}"/></geometry>'
    lane = only(read(tmp_path, road(plan)))
    centre = np.array([3 - math.sin(0.7) / curvature, -4 + math.cos(0.7) / curvature])
    away = np.hypot(*(points(lane) - centre).T)
    assert np.allclose(away, abs(1 / curvature + 1.75), rtol=0, atol=1e-9)
    turned = np.unwrap(np.arctan2(*(points(lane) - centre).T[::-1]))
    assert turned[-1] - turned[0] == pytest.approx(100 * curvature)


def test_a_spiral_is_that_of_fresnel() -> None:
    rate_per_m2, s_m = 0.02 / 80, np.linspace(0.0, 80.0, 33)
    scale = math.sqrt(math.pi / rate_per_m2)
    sine, cosine = fresnel(s_m / scale)
    x, y, heading = clothoid(0.0, 0.02, 80.0)(s_m)
    assert np.allclose([x, y], [scale * cosine, scale * sine], rtol=0, atol=1e-11)
    assert np.allclose(heading, rate_per_m2 * s_m**2 / 2, rtol=0, atol=1e-13)


def test_a_spiral_between_two_curvatures_is_its_integral() -> None:
    def theta(u: float) -> float:
        return -0.1 * u + 0.3 * u * u / 40

    x, y, _ = clothoid(-0.1, 0.5, 40.0)(np.array([40.0]))
    exact = [
        quad(lambda u, part=part: part(theta(u)), 0, 40, limit=200, epsabs=1e-12)[0] for part in (math.cos, math.sin)
    ]
    assert np.allclose([x[0], y[0]], exact, rtol=0, atol=1e-9)


def test_cubics_are_followed_by_their_parameter_or_their_length() -> None:
    v: Cubic = (0.0, 0.0, 0.01, 0.0)
    s_m = np.linspace(0.0, 50.0, 11)
    by_length = parametric_cubic((0.0, 1.0, 0.0, 0.0), v, 1.0)(s_m)
    normalized = parametric_cubic((0.0, 50.0, 0.0, 0.0), (0.0, 0.0, 0.01 * 50**2, 0.0), 50.0)(s_m)
    assert np.allclose(by_length, normalized, rtol=0, atol=1e-12)
    assert np.allclose(by_length[:2], [s_m, 0.01 * s_m**2])
    u, _, heading = cubic_by_length(v, 60.0)(s_m)
    slope = 0.02 * u
    arc_m = (slope * np.sqrt(1 + slope**2) + np.arcsinh(slope)) / 0.04
    assert np.allclose(arc_m, s_m, rtol=0, atol=1e-5)
    assert np.allclose(heading, np.arctan(slope))


def test_widths_offsets_and_borders_place_lanes(tmp_path: Path) -> None:
    offset = '<laneOffset s="0" a="0" b="0" c="0" d="0"/><laneOffset s="40" a="0" b="0.05" c="0" d="0"/>'
    inner = '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0.01" c="0" d="0"/></lane>'
    outer = '<lane id="-2" type="driving"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>'
    elements = read(tmp_path, road(LINE, offset + section(f"<right>{inner}{outer}</right>")))
    first, second = (next(one for one in elements if one["lane_id"] == f"1.0.{number}") for number in (-1, -2))
    assert (first["y_m"][0], first["y_m"][-1]) == (-1.5, pytest.approx(3.0 - 2.0))
    assert first["width_m"][-1] == pytest.approx(4.0)
    assert (second["y_m"][0], second["y_m"][-1]) == (-4.0, pytest.approx(3.0 - 5.0))
    borders = [
        '<lane id="-2" type="driving"><border sOffset="0" a="-5" b="-0.01" c="0" d="0"/></lane>',
        '<lane id="-1" type="driving"><border sOffset="0" a="-3" b="-0.01" c="0" d="0"/></lane>',
    ]
    again = read(tmp_path, road(LINE, offset + section(f"<right>{''.join(borders)}</right>")))
    for one, other in zip(elements, again, strict=True):
        assert np.allclose(points(one), points(other))
        assert np.allclose(one["width_m"], other["width_m"])


def test_sections_and_limits_cut_lanes_and_lanes_without_width_are_none(tmp_path: Path) -> None:
    speeds = '<speed sOffset="0" max="50" unit="km/h"/><speed sOffset="30" max="30" unit="mph"/>'
    first = RIGHT.replace("</lane>", f'{speeds}<speed sOffset="60" max="no limit"/></lane>')
    none = '<lane id="-2" type="driving"><width sOffset="0" a="0" b="0" c="0" d="0"/></lane>'
    of_road = '<type s="0" type="town"><speed max="10"/></type>'
    elements = read(
        tmp_path, road(LINE, section(first) + section(RIGHT.replace("</right>", f"{none}</right>"), 80.0), of_road)
    )
    assert [one["element_id"] for one in elements] == ["1.0.-1.0", "1.0.-1.1", "1.0.-1.2", "1.1.-1.0"]
    assert [one["lane_id"] for one in elements] == ["1.0.-1"] * 3 + ["1.1.-1"]
    assert [one["x_m"].tolist() for one in elements] == [[0, 30], [30, 60], [60, 80], [80, 100]]
    limits = [one["speed_limit_mps"] for one in elements]
    assert limits == [pytest.approx(50 / 3.6), pytest.approx(30 * 0.44704), None, 10.0]


def test_what_is_paved_beside_lanes_is_kept_and_pavements_are_not(tmp_path: Path) -> None:
    kinds = ["shoulder", "stop", "parking", "sidewalk", "biking", "none"]
    lanes = "".join(DRIVING.format(-2 - number).replace("driving", kind) for number, kind in enumerate(kinds))
    elements = read(tmp_path, road(LINE, section(f"<right>{DRIVING.format(-1)}{lanes}</right>")))
    assert [(one["kind"], one["lane_id"]) for one in elements] == [
        ("lane", "1.0.-1"), ("shoulder", None), ("shoulder", None), ("parking", None),
    ]  # fmt: skip


def test_signals_signs_and_stop_lines_name_the_lane_that_they_govern(tmp_path: Path) -> None:
    tags = [
        '<signal id="a" s="90" t="-6" dynamic="yes" orientation="+" type="1000001"/>',
        '<signal id="b" s="90" t="-6" dynamic="no" orientation="none" type="206"/>',
        '<signal id="c" s="90" t="-6" orientation="+" type="205"><validity fromLane="1" toLane="1"/></signal>',
        '<signal id="d" s="90" t="0" dynamic="no" orientation="-" type="294"/>',
        '<signal id="e" s="90" t="0" dynamic="no" orientation="+" type="274"/>',
    ]
    both = section(f"<left>{DRIVING.format(1)}</left>{RIGHT}")
    elements = read(tmp_path, road(LINE, both, f"<signals>{''.join(tags)}</signals>"))
    found = [(one["kind"], one["element_id"], one["lane_id"]) for one in elements if one["kind"] != "lane"]
    assert found == [
        ("signal", "1.signal.a", "1.0.-1"), ("stop_sign", "1.signal.b", None), ("yield_sign", "1.signal.c", "1.0.1"),
        ("stop_line", "1.signal.d.1", "1.0.1"),
    ]  # fmt: skip
    assert points(only(elements, "signal")).tolist() == [[90, -6]]
    assert np.allclose(points(only(elements, "stop_line")), [[90, 0], [90, 3.5]])


def test_crossings_and_stop_lines_that_are_objects(tmp_path: Path) -> None:
    corners = "".join(
        f'<cornerLocal u="{u}" v="{v}" z="0"/>' for u, v in ((-1, -4), (1, -4), (1, 4), (-1, 4), (-1, -4))
    )
    of_road = "".join(f'<cornerRoad s="{s}" t="{t}" dz="0"/>' for s, t in ((10, -2), (12, -2), (12, 2)))
    tags = [
        f'<object type="crosswalk" id="a" s="50" t="0" hdg="1.5707963267948966"><outline>{corners}</outline></object>',
        f'<object type="crosswalk" id="b" s="0" t="0"><outlines><outline>{of_road}</outline></outlines></object>',
        '<object type="crosswalk" id="c" s="70" t="0" hdg="0" length="4" width="8"/>',
        '<object type="-1" name="StopLine" id="d" s="48" t="-1.75" hdg="0" length="0.3" width="3.5"/>',
        '<object type="tree" id="e" s="48" t="-9" hdg="0" length="1" width="1"/>',
    ]
    elements = read(tmp_path, road(LINE, rest=f"<objects>{''.join(tags)}</objects>"))
    turned, corner, box = (points(one) for one in elements if one["kind"] == "crossing")
    assert sorted(map(tuple, turned.round(9).tolist())) == [(46, -1), (46, 1), (54, -1), (54, 1)]
    assert corner.tolist() == [[10, -2], [12, -2], [12, 2]]
    assert sorted(map(tuple, box.tolist())) == [(68, -4), (68, 4), (72, -4), (72, 4)]
    assert sorted(points(only(elements, "stop_line")).tolist()) == [[48, -3.5], [48, 0]]


ENDLESS = '<geometry s="0" x="0" y="0" hdg="0" length="1e7"><arc curvature="1e-9"/></geometry>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<OpenDRIVE>", "is no XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><OpenDRIVE/>', "declares a document type"),
        ("<OpenDRIVE/>", "has no lane that motor vehicles may drive"),
        (f"<OpenDRIVE>{road('')}</OpenDRIVE>", "road '1' has no <geometry>"),
        (f"<OpenDRIVE>{road(LINE.replace('<line/>', '<nurbs/>'))}</OpenDRIVE>", "is no line, arc, spiral"),
        (f"<OpenDRIVE>{road(LINE.replace('100', 'nan'))}</OpenDRIVE>", "length='nan' of <geometry> is no number"),
        (f"<OpenDRIVE>{road(LINE.replace('100', '-1'))}</OpenDRIVE>", "length='-1' of <geometry> is no number"),
        (
            f"<OpenDRIVE>{road(LINE.replace('<line/>', '<arc curvature=&quot;99&quot;/>').replace('&quot;', chr(34)))}"
            "</OpenDRIVE>",
            "turns by more than 1000 rad",
        ),
        (f"<OpenDRIVE>{road(LINE, section(f'<left>{DRIVING.format(-1)}</left>'))}</OpenDRIVE>", "none of its left"),
        (f"<OpenDRIVE>{road(ENDLESS, length=1e7)}</OpenDRIVE>", "choose a larger step_m"),
        (
            f"<OpenDRIVE>{road(rest='<type s=%s0%s><speed max=%sfast%s/></type>'.replace('%s', chr(34)))}</OpenDRIVE>",
            "max='fast' of <speed> is no number",
        ),
    ],
)  # fmt: skip
def test_what_no_map_can_be_made_of_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "town.xodr"
    path.write_text(text)
    with pytest.raises(bd.UsageError, match=message):
        bd.read_opendrive(path)


def test_a_file_that_is_not_there_or_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(bd.UsageError, match="No such file"):
        bd.read_opendrive(tmp_path / "none.xodr")
    monkeypatch.setattr(opendrive, "MOST_BYTES", 10)
    with pytest.raises(bd.UsageError, match="has more than 10 bytes"):
        read(tmp_path, road())


def test_lanes_of_many_vertices_are_cut_into_elements_that_meet(tmp_path: Path) -> None:
    plan = '<geometry s="0" x="0" y="0" hdg="0" length="2500"><arc curvature="0.001"/></geometry>'
    elements = read(tmp_path, road(plan, length=2500.0), step_m=0.1)
    assert max(len(one["x_m"]) for one in elements) == 10_000
    assert {one["lane_id"] for one in elements} == {"1.0.-1"}
    for one, other in pairwise(elements):
        assert (points(one)[-1] == points(other)[0]).all()


CURVES = [
    '<geometry s="0" x="10" y="-5" hdg="0.3" length="100"><line/></geometry>',
    '<geometry s="100" x="{}" y="{}" hdg="0.3" length="80"><spiral curvStart="0" curvEnd="0.02"/></geometry>',
    '<geometry s="180" x="{}" y="{}" hdg="1.1" length="120"><arc curvature="0.02"/></geometry>',
]


def bent_road() -> str:
    """A line, a spiral and an arc that join, with lanes of changing widths beside an offset."""
    x, y = 10 + 100 * math.cos(0.3), -5 + 100 * math.sin(0.3)
    scale = math.sqrt(math.pi * 80 / 0.02)
    v, u = (scale * part for part in fresnel(80 / scale))
    end = x + u * math.cos(0.3) - v * math.sin(0.3), y + u * math.sin(0.3) + v * math.cos(0.3)
    plan = CURVES[0] + CURVES[1].format(x, y) + CURVES[2].format(*end)
    offset = '<laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneOffset s="150" a="0.5" b="0" c="0.0003" d="0"/>'
    wider = '<width sOffset="60" a="3.5" b="0" c="0.001" d="-1e-6"/></lane>'
    right = "<right>" + DRIVING.format(-1).replace("</lane>", wider) + DRIVING.format(-2) + "</right>"
    centre = '<center><lane id="0" type="none"/></center>'
    first = section(f"<left>{DRIVING.format(1)}</left>{centre}{right}")
    return road(plan, offset + first + section(centre + RIGHT, 200.0), length=300.0)


def test_another_library_finds_the_lanes_where_we_do(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pyxodr.road_objects.network import RoadNetwork

        elements = read(tmp_path, bent_road(), step_m=0.05)
        network = RoadNetwork(str(tmp_path / "town.xodr"), resolution=0.1, ignored_lane_types=set())
        theirs = {
            f"1.{number}.{lane.id}": np.asarray(lane.centre_line)[:, :2]
            for number, part in enumerate(network.get_roads()[0].lane_sections)
            for lane in part.lanes
        }
    assert {one["lane_id"] for one in elements} == set(theirs)
    for name, line in theirs.items():
        ours = np.concatenate([points(one) for one in elements if one["lane_id"] == name])
        dense = np.concatenate([np.linspace(a, b, max(2, int(np.hypot(*(b - a)) / 0.01))) for a, b in pairwise(ours)])
        away = np.sqrt(((line[::20, None] - dense[None, ::2]) ** 2).sum(axis=2).min(axis=1))
        assert away.max() < 0.02, name


class RoadOfTheMap(ShortRoad):
    """Leaves it to the map what lies under the ego, and sees a light."""

    def observe(self) -> bd.Observation:
        seen: bd.Observation = super().observe()
        return replace(seen, on_road=None, lane_id=None, speed_limit_mps=None, traffic_light="green")


def test_a_dataset_on_an_imported_map_passes_every_rule_on_maps(tmp_path: Path) -> None:
    light = '<signals><signal id="a" s="490" t="9" dynamic="yes" orientation="+" type="1000001"/></signals>'
    lane = section(RIGHT.replace('a="3.5"', 'a="10.5"').replace("</lane>", '<speed sOffset="0" max="13.5"/></lane>'))
    roads = [
        road(
            f'<geometry s="0" x="-100" y="{y + 5.25}" hdg="0" length="500"><line/></geometry>', lane, light,
            length=500.0, name=f"r{y}",
        )
        for y in range(0, 4000, 100)
    ]  # fmt: skip
    streams = ("ego_route_state", "actor_risk_evidence", "controls", "route_result", "map")
    root, elements = tmp_path / "dataset", read(tmp_path, *roads)
    report = bd.collect_dataset(
        root, few_policies(streams=streams), {"Map": RoadOfTheMap}, num_groups=1, maps={"StraightRoad": elements}
    )
    assert not report.groups[0].refused_because
    judged = {tally.rule_id: tally.status for tally in bd.validate(root).tallies if tally.rule_id.startswith("BD-MAP-")}
    assert "fail" not in judged.values()
    assert {judged[f"BD-MAP-{number:03}"] for number in (1, 2, 3, 5, 6, 7)} == {"pass"}
