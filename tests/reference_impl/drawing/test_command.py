"""`branchdrive draw`: a picture of each scenario type, the same bytes every time, and one line for wrong usage."""

from __future__ import annotations

import io
import struct
import sys
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import pytest
from tests.reference_impl.drawing.invented import scene_of, write_invented
from tests.synthetic import bare_descriptor, bare_tables, write_dataset

from branchdrive import Rollout, open_dataset
from branchdrive.cli.main import run
from branchdrive_reference.collect.campaign import collect
from branchdrive_reference.drawing.picture import SIZE_PX, title

SEED, GROUPS = 3, 2


def draw(*arguments: object) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return run(["draw", *map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def size_of_png(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", content[16:24])
    return width, height


def lane_at_the_branch(nominal: Rollout) -> object:
    return nominal.tables["evidence"].to_pylist()[nominal.record["branch_frame"]]["lane_id"]


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("collected") / "d"
    collect(root, num_groups=GROUPS, seed=SEED)
    return root


@pytest.fixture(scope="module")
def invented(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("invented") / "d"
    write_invented(root)
    return root


def test_a_collected_dataset_gives_a_picture_of_each_scenario_type(collected: Path, tmp_path: Path) -> None:
    code, out, err = draw(collected, "--output", tmp_path / "new" / "p")
    assert (code, err) == (0, "")
    dataset = open_dataset(collected)
    types = {dataset.group(name).nominal.record["scenario_type"]: name for name in reversed(dataset.groups)}
    pictures = sorted((tmp_path / "new" / "p").iterdir())
    assert {path.stem for path in pictures} <= set(types.values())
    assert pictures
    assert [size_of_png(path) for path in pictures] == [SIZE_PX] * len(pictures)
    for line, path in zip(sorted(out.splitlines()), pictures, strict=True):
        record = dataset.group(path.stem).nominal.record
        told = f"{record['scenario_type']} in {record['town']}, branch at tick {record['branch_tick']}"
        assert scene_of(dataset, path.stem).lane_id == lane_at_the_branch(dataset.group(path.stem).nominal)
        assert line.startswith(f"{path}  {told} by {record['trigger_signal']}: 13 candidates, ")


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_equal_groups_give_equal_bytes_whatever_the_users_settings(invented: Path, tmp_path: Path, kind: str) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    assert draw(invented, "--output", first, "--format", kind)[0] == 0
    with matplotlib.rc_context({"font.size": 20, "lines.linewidth": 7, "svg.hashsalt": "mine", "savefig.dpi": 30}):
        assert draw(invented, "--output", second, "--format", kind)[0] == 0
    assert [path.name for path in first.iterdir()] == [f"g0.{kind}"]
    assert (first / f"g0.{kind}").read_bytes() == (second / f"g0.{kind}").read_bytes()


def test_an_svg_is_xml_without_date_or_maker(invented: Path, tmp_path: Path) -> None:
    draw(invented, "--output", tmp_path, "--format", "svg")
    text = (tmp_path / "g0.svg").read_text(encoding="utf-8")
    assert ElementTree.fromstring(text).tag.endswith("svg")
    assert not any(word in text for word in ("dc:date", "Matplotlib", str(tmp_path)))


def test_named_groups_are_drawn(invented: Path, tmp_path: Path) -> None:
    code, out, _ = draw(invented, "--output", tmp_path, "--group", "g2", "--group", "g1")
    assert code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["g1.png", "g2.png"]
    assert [line.split()[0] for line in out.splitlines()] == [str(tmp_path / name) for name in ("g2.png", "g1.png")]


def test_a_title_names_the_decision(invented: Path) -> None:
    assert title(scene_of(open_dataset(invented))) == (
        "CutIn  ·  g0",
        "town Town12  ·  route route-0  ·  ClearNoon  ·  branch at tick 100 (5.00 s)  ·  "
        "trigger brake = 0.500 (threshold 0.250, confidence 0.75) at tick 120",
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--group", "nobody"], "no group 'nobody' among the 3 groups"),
        (["--scenario", "Parade"], "no scenario type 'Parade'"),
        (["--scenario", "CutIn", "--group", "g0"], "not allowed with argument"),
        (["--format", "gif"], "invalid choice: 'gif'"),
    ],
    ids=["unknown group", "unknown type", "group and type", "unknown format"],
)
def test_wrong_usage_is_one_line(invented: Path, tmp_path: Path, arguments: list[str], told: str) -> None:
    code, out, err = draw(invented, "--output", tmp_path / "p", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert told in err
    assert not (tmp_path / "p").exists()


def test_an_output_that_is_a_file_is_refused(invented: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    code, _, err = draw(invented, "--output", tmp_path / "file")
    assert code == 2 and "is no folder" in err
    assert (tmp_path / "file").read_text() == "mine"


def test_an_output_is_demanded(invented: Path) -> None:
    code, _, err = draw(invented)
    assert code == 2 and "--output" in err


def test_a_missing_dataset_is_refused(tmp_path: Path) -> None:
    code, _, err = draw(tmp_path / "nothing", "--output", tmp_path / "p")
    assert code == 2 and "is no folder" in err


def test_a_dataset_without_actors_is_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "d", bare_tables(), bare_descriptor())
    code, _, err = draw(tmp_path / "d", "--output", tmp_path / "p")
    assert code == 2 and "`actor_risk_evidence`" in err and err.count("\n") == 1


def test_without_the_extra_the_error_is_the_line_that_installs_it(
    invented: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.startswith("branchdrive_reference.drawing."):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, _, err = draw(invented, "--output", tmp_path / "p")
    told = "branchdrive: `draw` needs the package 'matplotlib': pip install 'branchdrive[sim,plots]'\n"
    assert (code, err) == (2, told)
