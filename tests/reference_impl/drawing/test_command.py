"""`branchdrive draw`: a picture of each scenario type, the same bytes every time, and one line for wrong usage."""

from __future__ import annotations

import io
import struct
import sys
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import pyarrow.compute as pc
import pytest
from matplotlib.text import Text
from tests.reference_impl.collect.kept_collection import kept_collection
from tests.reference_impl.drawing.invented import scene_of, write_invented
from tests.sampling import sampled
from tests.synthetic import BRANCH_TICK, bare_descriptor, bare_tables, base_tables, descriptor, write_dataset

from branchdrive import Rollout, open_dataset
from branchdrive.cli.main import run
from branchdrive.runtime.environment import install_command
from branchdrive_reference.drawing.picture import SIZE_PX, draw_scene, title

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
    return kept_collection(tmp_path_factory.mktemp("collected") / "d", num_groups=GROUPS, seed=SEED)


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
    *lines, last = out.splitlines()
    for line, path in zip(sorted(lines), pictures, strict=True):
        scene = scene_of(dataset, path.stem)
        assert scene.lane_id == lane_at_the_branch(dataset.group(path.stem).nominal)
        touching = sum(bool(len(candidate.contacts)) for candidate in scene.candidates)
        assert line.startswith(f"{path.name}  touches in {touching} of 13 to +6.5 s")
    assert last.startswith(f"{len(pictures)} picture") and last.endswith(f" in {tmp_path / 'new' / 'p'}")


@pytest.mark.parametrize("kind", sampled(["png", "svg"], every=2))
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


@pytest.mark.usefixtures("blank")
def test_named_groups_are_drawn(invented: Path, tmp_path: Path) -> None:
    code, out, _ = draw(invented, "--output", tmp_path, "--group", "g2", "--group", "g1")
    assert code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["g1.png", "g2.png"]
    assert [line.split()[0] for line in out.splitlines()[:-1]] == ["g2.png", "g1.png"]
    assert out.splitlines()[-1] == f"2 pictures in {tmp_path}"


@pytest.mark.usefixtures("blank")
def test_all_draws_every_complete_group(invented: Path, tmp_path: Path) -> None:
    code, out, _ = draw(invented, "--output", tmp_path, "--all", "--format", "svg")
    assert code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["g0.svg", "g1.svg", "g2.svg"]
    assert out.splitlines()[-1] == f"3 pictures in {tmp_path}"


@pytest.mark.usefixtures("blank")
def test_a_chosen_group_that_lacks_rows_is_left_out_and_told(tmp_path: Path) -> None:
    shards = {folder: dict(tables) for folder, tables in base_tables().items()}
    tables = shards["raw/shard-00000"]
    cut = pc.and_(pc.equal(tables["observations"]["rollout_id"], "g0.brake_0.30.a1"),
                  pc.greater(tables["observations"]["tick"], BRANCH_TICK))  # fmt: skip
    tables["observations"] = tables["observations"].filter(pc.invert(cut))
    write_dataset(tmp_path / "d", shards, descriptor())
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "p", "--all", "--format", "svg")
    assert (code, [line.split("  ")[0] for line in out.splitlines()[:2]]) == (0, ["g1.svg", "g2.svg"])
    assert err.startswith(
        "branchdrive: not drawn: group 'g0' cannot be drawn: rollout 'g0.brake_0.30.a1' has no observations"
    )
    assert err.count("\n") == 1
    assert out.endswith(f"2 pictures in {tmp_path / 'p'}\n")
    code, out, err = draw(tmp_path / "d", "--output", tmp_path / "q", "--group", "g0")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (tmp_path / "q").exists()


@pytest.mark.parametrize("legend", ["rollout ends before +6.5 s", "a touch counts as gap 0; otherwise static objects"])
def test_a_picture_explains_its_marks(invented: Path, legend: str) -> None:
    scene = scene_of(open_dataset(invented))
    early = [candidate for candidate in scene.candidates if candidate.ends_early]
    texts = [text.get_text() for text in draw_scene(scene).findobj(Text)]
    assert early
    assert any(text.startswith(legend) for text in texts)
    told = [text for text in texts if text.startswith("none (to +")]
    untouched = [candidate for candidate in early if not len(candidate.contacts)]
    assert told == [f"none (to +{candidate.end_s:.2f} s)" for candidate in untouched]


def test_a_title_names_the_decision(invented: Path) -> None:
    assert title(scene_of(open_dataset(invented))) == (
        "CutIn  ·  g0",
        "town Town12  ·  route route-0  ·  ClearNoon  ·  branch at tick 100 (5.00 s)  ·  "
        "trigger brake = 0.930 (threshold 0.465, confidence 0.75) at tick 120",
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--group", "nobody"], "no group 'nobody' among the 3 groups"),
        (["--group", "G"], "no group 'G' among the 3 groups"),
        (["--group", "G"], "; did you mean g0 or g1 or g2?"),
        (["--scenario", "Parade"], "unknown scenario type 'Parade'; choose from CutIn"),
        (["--scenario", "CutIn", "--group", "g0"], "not allowed with argument"),
        (["--all", "--group", "g0"], "not allowed with argument"),
        (["--format", "gif"], "invalid choice: 'gif'"),
    ],
    ids=[
        "unknown group",
        "begun group",
        "groups that begin so",
        "unknown type",
        "group and type",
        "group and all",
        "unknown format",
    ],
)
def test_wrong_usage_is_one_line(invented: Path, tmp_path: Path, arguments: list[str], told: str) -> None:
    code, out, err = draw(invented, "--output", tmp_path / "p", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert told in err
    assert not (tmp_path / "p").exists()


def test_an_output_that_is_a_file_is_refused(invented: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    code, _, err = draw(invented, "--output", tmp_path / "file")
    assert code == 2 and "is not a folder" in err
    assert (tmp_path / "file").read_text() == "mine"


def test_an_output_is_demanded(invented: Path) -> None:
    code, _, err = draw(invented)
    assert code == 2 and "--output" in err


@pytest.mark.parametrize(
    ("place", "lacks"), [("nothing", "branchdrive.json"), ("file", "branchdrive.json"), ("unsealed", "MANIFEST.sha256")]
)
def test_an_unfinished_dataset_is_refused_as_a_study_refuses_it(tmp_path: Path, place: str, lacks: str) -> None:
    (tmp_path / "file").write_text("mine")
    write_invented(tmp_path / "unsealed")
    (tmp_path / "unsealed" / "MANIFEST.sha256").unlink()
    code, out, err = draw(tmp_path / place, "--output", tmp_path / "p")
    root = str(tmp_path / place)
    assert (code, out) == (2, "")
    assert err == f"branchdrive: {root!r} holds no finished dataset: there is no {lacks!r}\n"
    stderr = io.StringIO()
    assert run(["study", root], io.StringIO(), stderr) == 2
    assert stderr.getvalue() == err


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
    message = f"branchdrive: `draw` needs the package 'matplotlib': {install_command('sim', 'plots')}\n"
    assert (code, err) == (4, message)
