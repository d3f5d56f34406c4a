"""Predictions of others are held to the same demands, and stand in the same tables with a warning."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from textwrap import dedent
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.places import packed
from tests.reference_impl.benchmark.small_release import contents, invoke, smallest_protocol, write_protocol
from tests.sampling import sampled
from tests.waiting import PATIENCE_S

from branchdrive import DatasetError, UsageError, open_model
from branchdrive.contract.layout import LOCK_FILE
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.runtime.environment import install_command
from branchdrive_reference.benchmark.document import published_protocol
from branchdrive_reference.benchmark.foreign import mean_predictions
from branchdrive_reference.benchmark.prediction import locked_checkpoints
from branchdrive_reference.benchmark.release import benchmark_data, open_release, published_predictions

Columns = dict[str, list[Any]]


@pytest.fixture
def columns(done: Path) -> Columns:
    """Predictions of the test partition that hit every outcome that is there."""
    layer = open_model(done)
    targets = layer.targets("test")
    groups, keys = layer.groups("test"), layer.candidate_order
    found: Columns = {
        "group_id": [group for group in groups for _ in keys],
        "action_key": list(keys) * len(groups),
    }
    scalars = np.where(targets.scalars_available, targets.scalars, 0.0).reshape(-1, len(TARGETS))
    found |= {target.name: scalars[:, i].tolist() for i, target in enumerate(TARGETS)}
    paths = targets.trajectories.reshape(len(scalars), 10, len(TRAJECTORY))
    return found | {name: paths[:, :, i].tolist() for i, name in enumerate(TRAJECTORY)}


def _write(path: Path, columns: Columns) -> Path:
    pq.write_table(pa.table(columns), path)
    return path


def test_perfect_predictions_have_no_error_and_a_warning(done: Path, columns: Columns, tmp_path: Path) -> None:
    before = contents(done)
    file, output = _write(tmp_path / "mine.parquet", columns), tmp_path / "out"
    said = invoke("evaluate", done, "--predictions", file, "--name", "Mine", "--output", output, "--no-figures")
    assert "Warning: Predictions of Mine come from no locked checkpoint." in said
    results = json.loads((output / "results.json").read_bytes())
    errors = {row["metric"]: row["value"] for row in results["prediction"]["estimates"] if row["model"] == "Mine"}
    assert errors["macro_nmae"] == errors["ade_m"] == 0
    assert [model["id"] for model in results["models"] if not model["declared"]] == ["Mine"]
    found = {row["name"]: row for row in results["prediction"]["comparisons"]}
    m3 = next(row for row in results["prediction"]["estimates"] if (row["model"], row["metric"]) == ("M3", "ade_m"))
    assert found["Mine-M3.ade_m"]["difference"] == pytest.approx(-m3["value"])
    assert found["Mine-M3.macro_nmae"]["difference"] < 0
    selected = [row["name"] for row in results["ranking"]["comparisons"] if row["name"].startswith("O-Mine-O-M3.")]
    assert len(selected) == 2 * len(results["ranking"]["profiles"])
    tables = (output / "TABLES.md").read_text()
    assert "Tests in no family, of models that the protocol does not declare, explore" in tables
    assert f"which are in {output / 'TABLES.md'}" in " ".join(said.split())
    value = {row["selector"]: row["value"] for row in results["ranking"]["profiles"][0]["entries"]}
    assert value["O-Mine"] == pytest.approx(value["oracle"])
    assert tables.count("Predictions of Mine come from no locked checkpoint.") > 10
    assert contents(done) == before


def test_a_release_in_an_archive_will_do(done: Path, columns: Columns, tmp_path: Path) -> None:
    archive = packed(done, tmp_path / "done.zip")
    options = ("--predictions", _write(tmp_path / "mine.parquet", columns), "--name", "Mine", "--format", "json")
    assert invoke("evaluate", archive, *options) == invoke("evaluate", done, *options)
    with pytest.raises(UsageError, match="needs a folder of this machine"):
        invoke("evaluate", archive)
    release = open_release(archive)
    expected, found = (locked_checkpoints(one, one.document(LOCK_FILE), "M3") for one in (open_release(done), release))
    assert [one.sha256 for one in found] == [one.sha256 for one in expected] != []


def test_a_release_without_a_benchmark_will_do(bare: Path, columns: Columns, tmp_path: Path) -> None:
    file = _write(tmp_path / "mine.parquet", columns | {"seed": [7] * len(columns["group_id"])})
    results = json.loads(invoke("evaluate", bare, "--predictions", file, "--name", "Mine", "--format", "json"))
    assert [(model["id"], model["seeds"]) for model in results["models"]] == [("M0", [0]), ("Mine", [7])]
    assert results["guard"]["reason"] == "No risk was fitted."
    assert results["description"]["parameters"] == [{"model": "M0", "num_parameters": 0}]
    tables = invoke("evaluate", bare, "--predictions", file, "--name", "Mine", "--format", "markdown")
    assert tables.count("the rows of these take `branchdrive benchmark` on this release first.") == 2
    said = invoke("evaluate", bare, "--predictions", file, "--name", "Mine")
    assert "M0" in said and "Guard" not in said
    assert " ".join(said.split()).count("Predictions of Mine come from no locked checkpoint.") == 1


def test_without_predictions_it_says_how_to_have_some(bare: Path) -> None:
    with pytest.raises(UsageError, match=r"`branchdrive benchmark` makes them, .*`--predictions FILE --name NAME`"):
        invoke("evaluate", bare)


def test_the_mean_beside_them_is_the_locked_one(done: Path) -> None:
    release = open_release(done)
    data, protocol = benchmark_data(release), published_protocol(release)
    (locked,) = published_predictions(release, protocol, data).by_model["M0"].values()
    (mean,) = mean_predictions(data, protocol).by_model["M0"].values()
    report = protocol.partitions.report
    np.testing.assert_allclose(mean[report].scalars, locked[report].scalars, rtol=1e-7)  # training is in float32
    np.testing.assert_allclose(mean[report].paths, locked[report].paths, rtol=1e-6, atol=1e-6)


def test_what_was_not_evaluated_is_not_evaluated_by_the_way(release: Path, columns: Columns, tmp_path: Path) -> None:
    def models() -> tuple[list[str], str]:
        results = json.loads(invoke("evaluate", release, *options))
        return [model["id"] for model in results["models"]], " ".join(results["warnings"])

    options = ("--predictions", _write(tmp_path / "mine.parquet", columns), "--name", "Mine", "--format", "json")
    document = smallest_protocol()
    invoke("train", release, "--protocol", write_protocol(tmp_path / "protocol.json", document), "--no-guard")
    invoke("lock", release)
    invoke("predict", release)
    assert models()[0] == ["M0", "Mine"] and "have not been evaluated yet" in models()[1]
    invoke("evaluate", release, "--no-figures")
    assert len(models()[0]) == 3 and "left out" not in models()[1]
    write_protocol(tmp_path / "other.json", {**document, "version": "9.0.0"})
    options += ("--protocol", tmp_path / "other.json")
    assert models()[0] == ["M0", "Mine"] and "locked under another protocol" in models()[1]
    assert "no record of the release counts it" in models()[1]


def _lack(columns: Columns) -> None:
    for values in columns.values():
        del values[5]


def _repeat(columns: Columns) -> None:
    for values in columns.values():
        values.append(values[0])


def _set(column: str, value: Any) -> Callable[[Columns], None]:
    return lambda columns: columns[column].__setitem__(3, value)


def _more(group: str) -> Callable[[Columns], None]:
    def more(columns: Columns) -> None:
        for name, values in columns.items():
            values.append(group if name == "group_id" else values[0])

    return more


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_lack, "expected one row of this candidate, found no row"),
        (_repeat, "expected one row of this candidate, found several rows"),
        (_set("min_ttc_s", float("nan")), "expected a finite `min_ttc_s`, found nan"),
        (_set("x_m", [float("inf")] * 10), "expected a finite `x_m`, found inf"),
        (_set("x_m", [0.0] * 9), "column 'x_m' holds a list of another length, expected 10 values"),
        (
            _set("min_ttc_s", None),
            "column 'min_ttc_s' has no value in row 3, counted from 0, 1 in all; expected no nulls",
        ),
        (_set("x_m", [0.0] * 9 + [None]), "column 'x_m' has no value in row 3, counted from 0, 1 in all"),
        (_set("group_id", None), "column 'group_id' has no value in row 3"),
        (_set("action_key", "fly"), "expected a candidate and step of the bank"),
        (_set("group_id", "nobody"), "expected a group of the model layer"),
        (_more("train00"), "expected a group outside of 'train'"),
        (lambda columns: columns.pop("y_m"), "has no column 'y_m'"),
        (lambda columns: columns.update(more=columns["y_m"]), "unknown column 'more'"),
    ],
)
def test_faults_are_named(
    done: Path, columns: Columns, tmp_path: Path, change: Callable[[Columns], Any], message: str
) -> None:
    change(columns)
    file = _write(tmp_path / "mine.parquet", columns)
    with pytest.raises(DatasetError, match=message):
        invoke("evaluate", done, "--predictions", file, "--name", "Mine")


@pytest.mark.parametrize("has_figures", sampled([False, True], every=2))
def test_neither_torch_nor_cvxpy_is_needed(
    benchmarked: Path, columns: Columns, tmp_path: Path, has_figures: bool
) -> None:
    """Figures take seconds to draw; what draws them can be imported."""
    file = _write(tmp_path / "my predictions-00000.parquet", columns)
    missing = """
        import sys
        sys.modules |= dict.fromkeys(("torch", "safetensors", "cvxpy", "clarabel", "scipy", "pymunk", "numba"))
        import branchdrive_reference.benchmark.figure.gallery
    """
    theirs: tuple[object, ...] = (
        "evaluate",
        benchmarked,
        "--predictions",
        file,
        "--name",
        "Mine",
        "--output",
        tmp_path / "a/b",
    )
    ours = ("evaluate", benchmarked, "--no-figures")
    theirs += () if has_figures else ("--no-figures",)
    for has_theirs, ended in zip((True, False), ended_without(missing, theirs, ours), strict=True):
        assert (ended.code, "Mine" in ended.stdout) == (0, has_theirs), ended.stderr
    assert (tmp_path / "a/b/results.json").is_file()
    assert (tmp_path / "a/b/figures/prediction.png").is_file() is has_figures


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    stdout: str
    stderr: str


def ended_without(missing: str, *commands: tuple[object, ...]) -> list[Ended]:
    """How commands end, one after another in a process of their own that begins with the program `missing`."""
    program = dedent(missing) + dedent("""
        import io, json
        from branchdrive.cli.main import run
        ended = []
        for words in json.loads(sys.argv[1]):
            streams = io.StringIO(), io.StringIO()
            code = run(words, *streams)
            ended.append((code, *(stream.getvalue() for stream in streams)))
        print(json.dumps(ended))
    """)
    words = json.dumps([[str(word) for word in command] for command in commands])
    command = [sys.executable, "-P", "-c", program, words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (0, "")
    return [Ended(*found) for found in json.loads(done.stdout)]


WITHOUT_MATPLOTLIB = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name == "matplotlib":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Missing())
"""


def test_figures_that_cannot_be_drawn_open_nothing(benchmarked: Path) -> None:
    before = contents(benchmarked)
    for ended in ended_without(WITHOUT_MATPLOTLIB, ("evaluate", benchmarked), ("benchmark", benchmarked)):
        assert (ended.code, ended.stdout) == (4, "")
        assert f"{install_command('plots')}, or use `--no-figures`" in ended.stderr
    assert contents(benchmarked) == before


def test_options_go_together(done: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.parquet"
    for arguments, message in (
        (["--predictions", file], "need each other"),
        (["--output", tmp_path], "needs `--predictions`"),
        (["--predictions", file, "--name", "M3"], "is a model of the protocol"),
        (["--predictions", file, "--name", "M5"], "is a model of the protocol"),
        (["--predictions", file, "--name", "Mine", "--output", done / "x"], "lies inside the dataset"),
    ):
        with pytest.raises(UsageError, match=message):
            invoke("evaluate", done, *arguments)
