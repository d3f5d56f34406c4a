"""A dataset of a stranger: no file elsewhere, no escape sequence on the terminal, no traceback."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pytest
from tests.reference_impl.drawing.invented import scene_of, write_invented
from tests.reference_impl.study import samples
from tests.reference_impl.study.samples import Edit, replaced, rows_at
from tests.sampling import sampled
from tests.synthetic import BRANCH_TICK

from branchdrive import UsageError, open_dataset
from branchdrive.cli.main import run
from branchdrive_reference.drawing.gallery import picture_path
from branchdrive_reference.drawing.picture import title

NOMINAL, BRAKE = "g0.nominal.a1", "g0.brake_0.30.a1"
AHEAD = [BRANCH_TICK + 5 * j for j in range(1, 11)]
EVIL = "\x1b]0;mine\x07\x1b[2J\nsecond line \u202e" + "x" * 200


def draw(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return run(["draw", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def nominal(column: str, value: object) -> dict[str, Edit]:
    """A value in the rollouts table of the nominal."""
    return {"rollouts": replaced(column, {NOMINAL: value})}


def at_branch(table: str, column: str, value: object, rollout_id: str = NOMINAL) -> dict[str, Edit]:
    """A value in a stream at the branch."""
    return {table: replaced(column, {rollout_id: value}, rows_at(rollout_id, BRANCH_TICK))}


def crowd(table: pa.Table) -> pa.Table:
    """Actors with many actors at the branch."""
    here = table.filter(pa.array(rows_at(NOMINAL, BRANCH_TICK)(table)))
    return pa.concat_tables([table, *[here] * 600])


HOSTILE: dict[str, tuple[Mapping[str, Edit], str]] = {
    "no trigger value": (nominal("trigger_value", None), "`trigger_value` is absent"),
    "no trigger threshold": (nominal("trigger_threshold", None), "`trigger_threshold` is absent"),
    "no trigger confidence": (nominal("trigger_confidence", None), "`trigger_confidence` is absent"),
    "no trigger tick": (nominal("trigger_tick", None), "`trigger_tick` is absent"),
    "no trigger signal": (nominal("trigger_signal", None), "`trigger_signal` is absent"),
    "trigger value nan": (nominal("trigger_value", math.nan), "`trigger_value` is nan"),
    "ego without length": (nominal("ego_length_m", math.nan), "`ego_length_m` is nan"),
    "ego without end": (nominal("ego_length_m", math.inf), "`ego_length_m` is inf"),
    "ego inside out": (nominal("ego_width_m", -2.0), "`ego_width_m` is -2.0"),
    "routes of two lengths": (nominal("route_y_m", [0.0, 1.0, 2.0]), "its route has"),
    "route of one vertex": (
        {"rollouts": lambda t: replaced("route_x_m", {NOMINAL: [0.0]})(replaced("route_y_m", {NOMINAL: [0.0]})(t))},
        "its route has 1 x and 1 y values",
    ),
    "no route": (
        {"rollouts": lambda t: replaced("route_x_m", {NOMINAL: []})(replaced("route_y_m", {NOMINAL: []})(t))},
        "its route has 0 x and 0 y values",
    ),
    "route through nowhere": (
        {
            "rollouts": lambda t: replaced("route_x_m", {NOMINAL: [0.0, math.nan]})(
                replaced("route_y_m", {NOMINAL: [0.0, 1.0]})(t)
            )
        },
        "its route has a vertex that is no place",
    ),
    "a very long scenario name": (
        nominal("scenario_type", "x" * 3_000_000), "`scenario_type` has 3,000,000 characters",
    ),
    "a very long town": (nominal("town", "x" * 3_000_000), "`town` has 3,000,000 characters"),
    "a place that is none": (at_branch("observations", "x_m", math.nan), "`x_m` of candidate 'nominal'"),
    "a place without end": (at_branch("observations", "y_m", math.inf, BRAKE), "`y_m` of candidate 'brake_0.30'"),
    "a place out of this world": (at_branch("observations", "x_m", 1e300), "`x_m` of candidate 'nominal'"),
    "no heading": (at_branch("observations", "yaw_rad", math.nan), "`yaw_rad` of candidate 'nominal'"),
    "endless speed": (
        at_branch("observations", "speed_mps", -math.inf, BRAKE), "`speed_mps` of candidate 'brake_0.30'",
    ),
    "a gap to nobody": (
        {"evidence": replaced("separation_actor_id", {NOMINAL: None})}, "a `separation_m` without its",
    ),
    "endless gap": (at_branch("evidence", "separation_m", math.inf), "`separation_m` of candidate 'nominal'"),
    "gap below nothing": (at_branch("evidence", "separation_m", -1.0), "`separation_m` of candidate 'nominal'"),
    "evidence missing": (
        {"evidence": samples.dropped(rows_at(NOMINAL, BRANCH_TICK + 65))}, "has no evidence for each observation",
    ),
    "an actor nowhere": (at_branch("actors", "x_m", math.nan), "`x_m` of actor"),
    "an actor without heading": (at_branch("actors", "yaw_rad", math.inf), "`yaw_rad` of actor"),
    "an actor without size": (at_branch("actors", "length_m", math.nan), "`length_m` of actor"),
    "an actor without speed": (at_branch("actors", "vel_y_mps", math.nan), "`vel_y_mps` of actor"),
    "a crowd": ({"actors": crowd}, "actors at the branch; at most 1,000 are drawn"),
}  # fmt: skip


@pytest.mark.parametrize(("edits", "reason"), sampled(HOSTILE.values(), every=5), ids=HOSTILE)
def test_a_group_that_cannot_be_drawn_is_one_line(tmp_path: Path, edits: Mapping[str, Edit], reason: str) -> None:
    samples.written(tmp_path / "d", edits)
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--group", "g0")
    assert (code, out) == (2, "")
    assert err.startswith("branchdrive: group 'g0' cannot be drawn: ")
    assert reason in err
    assert err[:-1].isprintable() and len(err) < 400
    assert not (tmp_path / "p").exists()


@pytest.mark.usefixtures("blank")
@pytest.mark.parametrize("name", ["no trigger value", "a place that is none", "a gap to nobody"])
def test_a_group_that_cannot_be_drawn_gives_way_to_the_next_of_its_type(tmp_path: Path, name: str) -> None:
    samples.written(tmp_path / "d", HOSTILE[name][0])
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--format", "svg")
    assert (code, out.splitlines()[0].split("  ")[0]) == (0, "g1.svg")
    assert err.startswith("branchdrive: not drawn: group 'g0' cannot be drawn: ") and err.count("\n") == 1
    assert [path.name for path in (tmp_path / "p").iterdir()] == ["g1.svg"]


@pytest.mark.usefixtures("blank")
def test_a_type_without_picture_is_told_with_its_reasons(tmp_path: Path) -> None:
    others = {f"g{index}.nominal.a1": {"scenario_type": "Merge", "trigger_value": None} for index in (0, 2)}
    write_invented(tmp_path / "d", others)
    code, _, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--format", "svg")
    assert code == 0
    assert [path.name for path in (tmp_path / "p").iterdir()] == ["g1.svg"]
    *lines, last = err.splitlines()
    assert [line.split("'")[1] for line in lines] == ["g0", "g2"]
    assert last == "branchdrive: no picture of scenario type 'Merge': none of its 2 groups can be drawn"
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "q", "--scenario", "Merge")
    assert (code, out) == (2, "") and err.endswith("has no group that can be drawn\n")
    assert not (tmp_path / "q").exists()


@pytest.mark.usefixtures("blank")
@pytest.mark.parametrize("group_id", ["../../escaped", "ABSOLUTE", "..", "g0\n", ".g0", "g0/../../escaped", ""])
def test_no_picture_is_named_after_an_id_that_the_format_does_not_allow(tmp_path: Path, group_id: str) -> None:
    group_id = group_id.replace("ABSOLUTE", str(tmp_path / "escaped"))
    rows = samples.written(tmp_path / "plain")
    ids = [r for r in open_dataset(rows).rollouts()["rollout_id"].to_pylist() if r.startswith("g0.")]
    inner = tmp_path / "a" / "b"
    samples.written(inner / "d", {"rollouts": replaced("group_id", dict.fromkeys(ids, group_id))})
    before = sorted(tmp_path.rglob("*"))
    code, out, err = draw(inner / "d", "--output", inner / "p", "--all", "--format", "svg")
    assert (code, [line.split("  ")[0] for line in out.splitlines()[:-1]]) == (0, ["g1.svg", "g2.svg"])
    assert "an id that the format does not allow" in err and err.count("\n") == 1
    assert err[:-1].isprintable()
    added = set(tmp_path.rglob("*")) - set(before)
    assert added == {inner / "p", inner / "p" / "g1.svg", inner / "p" / "g2.svg"}
    assert draw(inner / "d", "--output", inner / "q", "--group", group_id)[0] == 2
    assert not (inner / "q").exists()
    with pytest.raises(UsageError, match="an id that the format does not allow"):
        picture_path(inner, group_id, "png")


def test_text_of_a_dataset_is_escaped_and_short_in_titles_and_on_the_terminal(tmp_path: Path) -> None:
    names = ("scenario_type", "town", "route_id", "environment", "trigger_signal")
    dataset = write_invented(tmp_path / "d", {NOMINAL: dict.fromkeys(names, EVIL)})
    heading, subheading = title(scene_of(dataset))
    shown = "\\x1b]0;mine\\x07\\x1b[2J\\nsecond line \\u202e"
    assert heading.startswith(shown) and len(heading) < 80
    assert subheading.count("\\x1b]0;mine\\x07") == 4
    assert heading.isprintable() and subheading.isprintable()
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--format", "svg")
    assert code == 0
    assert all(line.isprintable() for text in (out, err) for line in text.splitlines())
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "q", "--scenario", "\x1b\x07nobody")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err[:-1].isprintable() and "\\x1b\\x07nobody" in err and shown in err


def test_neither_warnings_nor_log_lines_reach_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    everywhere = {"actors": lambda table: replaced("x_m", {NOMINAL: 9e6}, rows_at(NOMINAL, *AHEAD))(table)}
    samples.written(
        tmp_path / "d", {**everywhere, **at_branch("evidence", "separation_m", math.nan), **nominal("town", "\u4e2d")}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, _, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--group", "g0", "--group", "g1")
    assert (code, err) == (0, "")
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


def test_an_output_inside_the_dataset_is_refused(tmp_path: Path) -> None:
    write_invented(tmp_path / "d")
    before = sorted((tmp_path / "d").rglob("*"))
    for place in ("d", "d/pictures", "d/raw/shard-00000"):
        code, out, err = draw(tmp_path / "d", "--output", tmp_path / place)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "lies inside the dataset" in err
    assert sorted((tmp_path / "d").rglob("*")) == before


def test_text_that_would_not_fit_in_memory_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("branchdrive.formats.table_file.written_out_bytes", lambda table: 300_000_000)
    write_invented(tmp_path / "d")
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "p")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "its text is" in err and "and may be 268,435,456" in err
