"""`branchdrive init` writes a package whose collector, tests and workflow work at once."""

from __future__ import annotations

import io
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from tests.sampling import THOROUGH

from branchdrive.cli.init import skeleton
from branchdrive.cli.main import run


def init(*arguments: object) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    return run(["init", *map(str, arguments)], out, err), out.getvalue(), err.getvalue()


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *arguments], cwd=folder, capture_output=True, text=True, check=False)


@THOROUGH
def test_the_package_collects_validates_and_passes_its_tests(tmp_path: Path, quick: None) -> None:
    folder = tmp_path / "my-world"
    code, out, err = init("my-world", "--output", folder)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"created   {folder}: 7 files, of which my_world/collector.py is the one to change",
        "note      the workflow leaves open where branchdrive comes from; --from LOCATION says it",
        f"next      cd {folder} && pip install -e . pytest && pytest",
    ]
    collected = python(folder, "my_world.collector", "build/dataset")
    assert collected.returncode == 0, collected.stderr
    validated = io.StringIO()
    options = ("--require-groups", "1", "--strict")
    assert run(["validate", str(folder / "build/dataset"), *options], validated, validated) == 0, validated.getvalue()
    assert "my-world 0.1.0" in validated.getvalue()
    tested = python(folder, "pytest", "-q", "-p", "no:cacheprovider")
    assert tested.returncode == 0, tested.stdout
    assert "3 passed" in tested.stdout


def test_a_location_is_pinned_where_the_user_gives_one(tmp_path: Path) -> None:
    where = "git+https://x.example/branchdrive.git@abc"
    for location, url in ((where, where), (str(tmp_path), tmp_path.as_uri())):
        files = skeleton("my-world", "my_world", location)
        assert f"branchdrive @ {url}" in tomllib.loads(files["pyproject.toml"])["project"]["dependencies"]
        assert f'pip install "branchdrive @ {url}"' in files[".github/workflows/validate.yml"]
    assert 'pip install "./vendor/branchdrive.whl"' in skeleton("a", "a")[".github/workflows/validate.yml"]


def test_the_workflow_runs_what_the_readme_says() -> None:
    files = skeleton("my-world", "my_world")
    for place in ("README.md", ".github/workflows/validate.yml"):
        assert "python -m my_world.collector build/dataset --groups 2 --seed 1" in files[place]
        assert "branchdrive-validate build/dataset" in files[place]
    assert tomllib.loads(files["pyproject.toml"])["project"]["name"] == "my-world"


def test_no_placeholder_and_nothing_of_the_example_is_left() -> None:
    for place, text in skeleton("my-world", "my_world").items():
        assert "@module@" not in text and "@name@" not in text and "@location@" not in text, place
        assert "minimal_collector.py" not in text and '"minimal' not in text, place


@pytest.mark.parametrize("name", ["My-World", "-a", "a--b", "a_b", "class", "branchdrive", "", "a" * 65, "../a"])
def test_names_that_cannot_be_used_are_refused(tmp_path: Path, name: str) -> None:
    code, out, err = init("--output", tmp_path / "there", "--", name)
    assert (code, out) == (2, "")
    assert "cannot be used; take lower-case words with hyphens, such as my-world" in err
    assert not (tmp_path / "there").exists()


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    code, _, err = init("my-world", "--output", tmp_path)
    assert code == 2
    assert "is there and not empty; choose another folder with --output" in err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
