"""The distribution as users get it: the wheel that is built from the source archive."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from tests.repo.checkout import ROOT
from tests.waiting import PATIENCE_S

import branchdrive
from branchdrive.contract.rule import CATALOGUE

MAX_WHEEL_BYTES = 4_000_000
CASES, CASES_NAME = ROOT / "conformance_tests" / "cases", "branchdrive-conformance-cases"

HEAVY = ("torch", "pymunk", "cvxpy", "scipy", "cv2", "numba")

PROBE = """
import contextlib, io, json, sys
import branchdrive
import branchdrive.cli.main
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    branchdrive.cli.main.run(["--help"], sys.stdout, sys.stderr)  # it loads every command
from branchdrive.contract.resources import load_resource, schema_dir
public = list(branchdrive.__all__)
print(json.dumps({
    "package": branchdrive.__file__,
    "public": [name for name in public if hasattr(branchdrive, name)],
    "schemas": str(schema_dir()),
    "rules": len(load_resource("rules.json")["rules"]),
    "modules": sorted(sys.modules),
}))
"""


def run(*command: str, **options: Any) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return str(done.stdout)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a source archive that was built from this checkout."""
    out = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(ROOT))
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def cases_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of the conformance cases."""
    out = tmp_path_factory.mktemp("cases")
    run(
        sys.executable,
        "-m",
        "build",
        "--no-isolation",
        "--wheel",
        "--outdir",
        str(out),
        str(ROOT / "conformance_tests"),
    )
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed in it, dependencies left out."""
    target = tmp_path_factory.mktemp("site")
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-compile")
    run(*pip, "--no-deps", "--no-index", "--target", str(target), str(wheel))
    return target


@pytest.fixture(scope="module")
def probe(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a fresh interpreter sees after importing the installed package, and after the help of its command."""
    environment = {**os.environ, "PYTHONPATH": str(site)}
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    result: dict[str, Any] = json.loads(run(sys.executable, "-c", PROBE, env=environment, cwd=elsewhere))
    return result


def test_wheel_is_small(wheel: Path) -> None:
    assert wheel.stat().st_size <= MAX_WHEEL_BYTES
    with ZipFile(wheel) as archive:
        assert sum(entry.file_size for entry in archive.infolist()) <= 2 * MAX_WHEEL_BYTES
        assert not [name for name in archive.namelist() if name.startswith("branchdrive_conformance/_cases/")]


def test_cases_are_a_distribution_of_the_same_version(wheel: Path, cases_wheel: Path) -> None:
    mine, theirs = (path.name.split("-") for path in (wheel, cases_wheel))
    assert [*theirs] == ["branchdrive_conformance_cases", *mine[1:]]
    with ZipFile(cases_wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    cases = {path.relative_to(CASES).as_posix() for path in CASES.rglob("*") if path.is_file()}
    assert names == {f"branchdrive_conformance_cases/{path}" for path in (*cases, "case.schema.json")}


def test_kit_reads_the_installed_cases_and_says_how_to_get_them(site: Path, cases_wheel: Path, tmp_path: Path) -> None:
    kit = (sys.executable, "-c", "from branchdrive_conformance.entry import main; raise SystemExit(main())")
    call = (*kit, "materialize", "made", "--select", "BD-VAL-001")
    environment = {**os.environ, "PYTHONPATH": str(site)}
    without = subprocess.run(call, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=PATIENCE_S)
    place = json.loads(next(site.glob("branchdrive-*.dist-info/direct_url.json")).read_text())["url"]
    beside = place.replace("/branchdrive-", "/branchdrive_conformance_cases-")
    assert (without.returncode, without.stdout) == (2, "")
    assert f"no conformance cases of version 0.1 are installed: pip install '{CASES_NAME} @ {beside}'" in without.stderr
    with ZipFile(cases_wheel) as archive:
        archive.extractall(tmp_path / "cases")
    environment["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'cases'}"
    assert "cases written to made" in run(*call, env=environment, cwd=tmp_path)


def test_wheel_holds_every_schema(wheel: Path) -> None:
    schemas = {path.relative_to(ROOT / "schemas").as_posix() for path in (ROOT / "schemas").rglob("*.json")}
    with ZipFile(wheel) as archive:
        assert {f"branchdrive/_schemas/{path}" for path in schemas} <= set(archive.namelist())


def test_wheel_holds_the_skeleton_of_a_collector(wheel: Path) -> None:
    texts = [path.name for path in (ROOT / "validator/branchdrive/cli/skeleton").iterdir()]
    with ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert len(texts) == 5
    assert {f"branchdrive/cli/skeleton/{name}" for name in texts} <= names
    assert "branchdrive/_examples/minimal_collector.py" in names


@pytest.mark.parametrize("marker", ["branchdrive/py.typed", "branchdrive_reference/py.typed"])
def test_wheel_says_that_it_is_typed(wheel: Path, marker: str) -> None:
    with ZipFile(wheel) as archive:
        assert marker in archive.namelist()


def test_wheel_holds_packages_only(wheel: Path) -> None:
    with ZipFile(wheel) as archive:
        tops = {path.split("/")[0] for path in archive.namelist()}
    packages = {"branchdrive", "branchdrive_conformance", "branchdrive_reference"}
    assert {top for top in tops if not top.endswith(".dist-info")} == packages


def test_wheel_has_the_readme_and_the_pages_of_rules(wheel: Path) -> None:
    with ZipFile(wheel) as archive:
        (place,) = [path for path in archive.namelist() if path.endswith(".dist-info/METADATA")]
        metadata = archive.read(place).decode()
        names = set(archive.namelist())
    assert "\nDescription-Content-Type: text/markdown\n" in metadata
    assert metadata.endswith((ROOT / "README.md").read_text("utf-8"))
    assert {f"branchdrive/_rules/{rule}.md" for rule in CATALOGUE} <= names


def test_installed_package_is_the_one_that_is_imported(probe: dict[str, Any], site: Path) -> None:
    assert Path(probe["package"]).is_relative_to(site)


def test_installed_package_has_its_public_names(probe: dict[str, Any]) -> None:
    assert probe["public"] == list(branchdrive.__all__)


def test_installed_package_reads_its_own_schemas(probe: dict[str, Any], site: Path) -> None:
    assert Path(probe["schemas"]).is_relative_to(site / "branchdrive" / "_schemas")
    assert probe["rules"] > 0


def test_importing_stays_light(probe: dict[str, Any]) -> None:
    assert set(probe["modules"]).isdisjoint(HEAVY)
