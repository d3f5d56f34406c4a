"""What a machine lacks is said in one line, with exit code 4, and is no finding about data."""

from __future__ import annotations

import io
import os
import sys
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.validator.engine import datasets
from tests.validator.runtime.tasks import cannot_import, lack

import branchdrive
from branchdrive.cli.main import run, validate_run
from branchdrive.errors import PlatformError, ToolError
from branchdrive.runtime import environment
from branchdrive.runtime.environment import check_environment, check_libraries, extra, requirements
from branchdrive.runtime.executor import in_process, isolated


@pytest.fixture(autouse=True)
def _forgotten() -> None:
    """Nothing was found out before."""
    check_environment.cache_clear()


def validated(root: Path | str) -> tuple[int, str, str]:
    stdout, stderr = io.StringIO(), io.StringIO()
    return validate_run([str(root)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def test_every_requirement_of_the_distribution_is_a_lowest_version() -> None:
    own = "branchdrive["  # an extra that takes in another one
    declared = [line for line in metadata.requires("branchdrive") or [] if not line.startswith(own)]
    assert len(requirements()) == len(declared)
    assert {"numpy", "pyarrow", "pydantic"} <= {one.name for one in requirements() if not one.extra}
    assert {"sim", "models", "guard", "export", "plots"} <= {one.extra for one in requirements()}


def test_versions_compare_by_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    bound = next(one.bound for one in requirements() if one.name == "pyarrow")
    for found, is_old in {
        "15.0.0": True, "9.0": True, "17.99.99": True, bound: False, f"{bound}.0.0": False, f"{bound}.0rc1": True,
        f"{bound}.1rc1": False,
        "100": False, "unknown": False, "1!2.0": False,
    }.items():  # fmt: skip
        monkeypatch.setattr(environment, "version", lambda name, found=found: found if name == "pyarrow" else "999")
        if is_old:
            with pytest.raises(PlatformError, match=rf"pyarrow>={bound}, found {found}; run: pip install 'pyarrow>="):
                check_libraries("")
        else:
            check_libraries("")


def test_a_library_that_is_too_old_is_one_line_and_exit_code_4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = datasets.write(tmp_path / "dataset")
    true = metadata.version
    monkeypatch.setattr(environment, "version", lambda name: "15.0.0" if name == "pyarrow" else true(name))
    line = "branchdrive-validate: branchdrive needs pyarrow>=18, found 15.0.0; run: pip install 'pyarrow>=18'\n"
    assert validated(root) == (4, "", line)
    monkeypatch.delitem(vars(branchdrive), "validate", raising=False)
    with pytest.raises(PlatformError, match="found 15"):
        branchdrive.validate  # noqa: B018
    with pytest.raises(SystemExit) as stop:  # help needs no system calls
        run(["--help"], io.StringIO(), io.StringIO())
    assert stop.value.code == 0


def test_a_platform_without_the_calls_we_need_says_so_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "geteuid", "register_at_fork"):
        monkeypatch.delattr(os, name)
    monkeypatch.setattr(os, "supports_dir_fd", set())
    monkeypatch.setattr(sys, "platform", "win32")
    message = "branchdrive needs a POSIX system; win32 lacks os.O_DIRECTORY, os.O_NOFOLLOW, os.O_NONBLOCK, os.geteuid, "
    message += "os.register_at_fork, os.open(dir_fd=...): use Linux or macOS, or WSL on Windows"
    assert validated(tmp_path) == (4, "", f"branchdrive-validate: {message}\n")
    for name in ("open_dataset", "DatasetWriter", "validate"):
        monkeypatch.delitem(vars(branchdrive), name, raising=False)
        with pytest.raises(ToolError, match="win32 lacks os"):
            getattr(branchdrive, name)


def test_extras_come_from_where_the_distribution_came(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = {
        None: "pip install 'branchdrive[media,sim]'",
        '{"url": "file:///a%20b/checkout", "dir_info": {"editable": true}}': ("pip install '/a b/checkout[media,sim]'"),
        '{"url": "file:///x/branchdrive-0.1.0-py3-none-any.whl", "archive_info": {}}': (
            "pip install 'branchdrive[media,sim] @ file:///x/branchdrive-0.1.0-py3-none-any.whl'"
        ),
        '{"url": "https://x.example/r.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}}': (
            "pip install 'branchdrive[media,sim] @ git+https://x.example/r.git@abc'"
        ),
    }
    for recorded, command in commands.items():
        made = SimpleNamespace(read_text=lambda name, recorded=recorded: recorded)
        monkeypatch.setattr(environment, "distribution", lambda name, made=made: made)
        environment._origin.cache_clear()
        assert environment.install_command("media", "sim") == command
    environment._origin.cache_clear()


def test_another_distribution_comes_from_where_this_one_came(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = {
        None: "pip install branchdrive-more",
        '{"url": "file:///a%20b/checkout", "dir_info": {"editable": true}}': "pip install '/a b/checkout/parts'",
        '{"url": "file:///x/branchdrive-0.1.0-py3-none-any.whl", "archive_info": {}}': (
            "pip install 'branchdrive-more @ file:///x/branchdrive_more-0.1.0-py3-none-any.whl'"
        ),
        '{"url": "https://x.example/branchdrive-0.1.0.tar.gz", "archive_info": {}}': (
            "pip install 'branchdrive-more @ https://x.example/branchdrive-0.1.0.tar.gz#subdirectory=parts'"
        ),
        '{"url": "https://x.example/r.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}}': (
            "pip install 'branchdrive-more @ git+https://x.example/r.git@abc#subdirectory=parts'"
        ),
    }
    for recorded, command in commands.items():
        made = SimpleNamespace(read_text=lambda name, recorded=recorded: recorded)
        monkeypatch.setattr(environment, "distribution", lambda name, made=made: made)
        environment._origin.cache_clear()
        assert environment.folder_command("branchdrive-more", "parts") == command
    environment._origin.cache_clear()


def test_modules_are_known_by_their_distribution() -> None:
    """Of every library that is installed here, a module is found under the name that messages look for."""
    names: dict[str, set[str]] = {}
    for module, found in metadata.packages_distributions().items():
        for name in found:
            names.setdefault(name.lower(), set()).add(module.lower())
    for one in requirements():
        if one.extra not in ("dev", "test") and (modules := names.get(one.name.lower())):
            assert environment.MODULES.get(one.name, one.name.replace("-", "_")).lower() in modules, one.name


def test_an_extra_is_blamed_for_what_it_brings_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_origin", lambda: "")

    def missing(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    messages = {
        "torch": r"a thing needs the package 'torch': pip install 'branchdrive\[models\]', or go without$",
        "PIL": r"a thing needs the package 'pillow': pip install 'branchdrive\[models\]', or go without$",
        "cv2": r"a thing needs the package 'opencv-python-headless': pip install 'branchdrive\[models\]', or",
        "torch.nowhere": "a thing cannot be loaded: No module named 'torch.nowhere'; reinstall",
        "llvmlite": "a thing cannot be loaded: No module named 'llvmlite'; reinstall",
    }
    for name, message in messages.items():
        with pytest.raises(PlatformError, match=message), extra("models", of="a thing", otherwise="go without"):
            missing(name)
    with pytest.raises(PlatformError, match="cannot import name 'nothing' from 'json'"), extra("sim", of="a thing"):
        from json import nothing  # type: ignore[attr-defined]  # noqa: F401


def test_what_a_task_lacks_ends_the_run_and_is_no_result() -> None:
    for executor in (in_process, isolated(1)):
        with pytest.raises(PlatformError, match="this command cannot be loaded: libarrow"):
            list(executor(cannot_import, [1]))
        with pytest.raises(PlatformError, match="no disk for 1"):
            list(executor(lack, [1]))
