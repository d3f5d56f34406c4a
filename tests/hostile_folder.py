"""A folder whose files leave a mark as soon as somebody imports a module by a common name, and commands run in it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.waiting import PATIENCE_S

__all__ = ["infest", "marks", "run_command", "run_commands", "run_module"]

_NAMES = (
    "_bootlocale", "asyncio", "branchdrive", "branchdrive_reference", "collections", "concurrent", "ctypes", "cvxpy",
    "email", "encodings", "importlib", "json", "jsonschema", "logging", "matplotlib", "multiprocessing", "numba",
    "numpy", "pandas", "pickle", "pyarrow", "pymunk", "re", "rich", "scipy", "selectors", "signal", "sitecustomize",
    "struct", "threading", "torch", "usercustomize", "yaml",
)  # fmt: skip
_CODE = "open({mark!r} + __name__, 'w').close()\n"
_FILES = {
    ".numba_config.yaml": "cache_dir: kernels\ndisable_jit: 1\n",
    "matplotlibrc": "backend: module://re\n",
    "evil-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n",
    "evil-1.0.dist-info/entry_points.txt": "[branchdrive.commands]\nvalidate = pickle\ncollect = re\nevil = struct\n"
    "[branchdrive.leakage]\na = json:classifier\n[numba_extensions]\ninit = re:init\n[pydantic]\nplugin = re:plugin\n",
    "branchdrive-9.egg-info/PKG-INFO": "Metadata-Version: 2.1\nName: branchdrive\nVersion: 9\n"
    "Requires-Dist: numpy>=99\n",
}
_SEVERAL = """
import json, sys
from branchdrive.cli.main import run
codes = [run(words, sys.stderr, sys.stderr) for words in json.loads(sys.argv[1])]
print(json.dumps(codes))
"""


def infest(folder: Path, marks_dir: Path) -> Path:
    """Put hostile modules into `folder`, and packages of the same names into a folder in it, which is returned."""
    marks_dir.mkdir(exist_ok=True)
    packages = folder / "packages"
    code = _CODE.format(mark=f"{marks_dir}/")
    for name in _NAMES:
        (packages / name).mkdir(parents=True)
        (packages / name / "__init__.py").write_text(code)
        (folder / f"{name}.py").write_text(code)
    for place in (folder, packages):
        for path, text in _FILES.items():
            (place / path).parent.mkdir(exist_ok=True)
            (place / path).write_text(text)
    return packages


def marks(marks_dir: Path) -> list[str]:
    """Names of the hostile modules that somebody has imported."""
    return sorted(path.name for path in marks_dir.iterdir())


def run_command(
    script: str, *arguments: object, cwd: Path, path: str | None = None
) -> subprocess.CompletedProcess[str]:
    """A console script of this installation, in the folder `cwd` and with nothing but `path` as `PYTHONPATH`."""
    return _run([Path(sys.executable).with_name(script), *map(str, arguments)], cwd, path)


def run_module(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """``python -P -m branchdrive.cli``, in the folder `cwd` and without a `PYTHONPATH`."""
    return _run([sys.executable, "-P", "-m", "branchdrive.cli", *map(str, arguments)], cwd, "")


def run_commands(*commands: tuple[object, ...], cwd: Path) -> tuple[list[int], str]:
    """Commands one after another in one process, which sees the same modules as a script; exit codes, and all it said.

    Libraries that take seconds to load are loaded once.
    """
    words = json.dumps([[str(word) for word in command] for command in commands])
    done = _run([sys.executable, "-P", "-c", _SEVERAL, words], cwd, "")
    assert done.returncode == 0, done.stderr
    codes: list[int] = json.loads(done.stdout)
    return codes, done.stderr


def _run(words: list[str | Path], cwd: Path, path: str | None) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    environment |= {} if path is None else {"PYTHONPATH": path}
    return subprocess.run(
        words, cwd=cwd, capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=environment
    )
