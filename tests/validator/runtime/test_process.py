"""Child processes: what they import, and that the process that starts them stays as it is."""

from __future__ import annotations

import os
import platform
import re
import signal
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
from tests.hostile_folder import infest, marks
from tests.repo.checkout import ROOT
from tests.validator.engine import datasets
from tests.validator.runtime.tasks import faults_of_a_second_array, variables, who_i_am
from tests.waiting import PATIENCE_S, wait_for

from branchdrive.runtime.process import ARRAY_WORK, ArrayContexts, array_context, spawn_context

SCRIPT = """
import os, sys
from branchdrive import isolated, validate

if __name__ == "__main__":
    os.chdir(sys.argv[1])
    before = dict(os.environ)
    report = validate(".", executor=isolated(2))
    assert dict(os.environ) == before
    print(report.exit_code, len(report.errors))
"""

STARTS = re.compile(
    r"get_context|sys\.executable|(?<!Bounded)Process\(|set_start_method|os\.(fork|exec|spawn|system|popen)"
)
"""What starts a process, or says how."""


def test_workers_of_a_script_import_nothing_from_the_folder_it_changes_to(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "script.py").write_text(SCRIPT)
    infest(datasets.write(tmp_path / "hostile"), tmp_path / "marks")
    done = subprocess.run(
        [sys.executable, "script.py", tmp_path / "hostile"],
        cwd=tmp_path / "elsewhere", capture_output=True, text=True, check=False, timeout=PATIENCE_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([".", "", "packages"])},
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("1 0\n", "")
    assert marks(tmp_path / "marks") == []


def test_two_modules_know_how_children_are_started() -> None:
    sources = [path for package in ("validator", "reference_impl") for path in (ROOT / package).rglob("*.py")]
    found = {path.name for path in sources if STARTS.search(path.read_text(encoding="utf-8"))}
    assert found == {"fork_server.py", "process.py"}


def test_an_interpreter_whose_children_cannot_be_made_safe_is_refused() -> None:
    code = "from branchdrive.runtime.process import spawn_context; spawn_context()"
    for flags, returncode in ((["-E"], 1), (["-E", "-P"], 0), (["-I"], 0)):
        done = subprocess.run([sys.executable, *flags, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == returncode
        assert ("start Python with -P or -I as well" in done.stderr) == bool(returncode)


# --- processes that compute with arrays


@pytest.fixture(params=[True, False], ids=["forked", "spawned"])
def is_forked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether a server forks them."""
    may_fork: bool = request.param
    if may_fork and sys.platform != "linux":
        pytest.skip("forked on Linux alone")
    monkeypatch.setattr("branchdrive.runtime.process._MAY_FORK", may_fork)
    return may_fork


def test_workers_of_the_validator_have_an_environment_for_arrays_and_others_the_one_they_were_given(
    is_forked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = dict.fromkeys(ARRAY_WORK, "3") | {
        "ARROW_DEFAULT_MEMORY_POOL": "mimalloc",
        "JE_ARROW_MALLOC_CONF": "narenas:1",
    }
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    with array_context() as for_arrays:
        for context, expected in ((for_arrays, dict(ARRAY_WORK)), (spawn_context(), given)):
            with ProcessPoolExecutor(1, context) as pool:
                assert pool.submit(variables, list(ARRAY_WORK)).result() == expected
            assert variables(list(ARRAY_WORK)) == given


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other allocators decide for themselves")
def test_workers_of_the_validator_keep_the_memory_of_arrays(is_forked: bool) -> None:
    with array_context() as context, ProcessPoolExecutor(1, context) as pool:
        assert pool.submit(faults_of_a_second_array, 2_000_000).result() < 50


def test_a_server_forks_workers_with_its_modules_and_without_threads(is_forked: bool) -> None:
    with array_context("branchdrive.engine.reading", "pyarrow.parquet") as context:
        with ProcessPoolExecutor(2, context) as pool:
            found = list(pool.map(who_i_am, range(2)))
            (parent,) = {parent for _, parent, _ in found}
            assert (parent != os.getpid()) == is_forked
            if is_forked:
                assert len(list(Path(f"/proc/{parent}/task").iterdir())) == 1
                assert "pyarrow.parquet" in found[0][2]
        assert not is_forked or Path(f"/proc/{parent}").exists()
    assert not is_forked or not Path(f"/proc/{parent}").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_a_server_that_stays_loads_what_later_workers_need_and_ends_with_its_contexts() -> None:
    contexts, servers, loaded = ArrayContexts(), [], []
    # Both contexts are there before the first worker is: each has the modules that it was asked for.
    for module, context in [(name, contexts.get(name)) for name in ("wave", "branchdrive.formats.manifest")]:
        with ProcessPoolExecutor(1, context) as pool:
            _, server, modules = pool.submit(who_i_am, 0).result()
        servers.append(server)
        loaded.append(module in modules)
    assert servers[0] == servers[1] != os.getpid()
    assert all(loaded)
    del contexts
    assert not Path(f"/proc/{servers[0]}").exists()


def test_workers_have_the_environment_of_their_start(is_forked: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    contexts = ArrayContexts()
    for value in ("first", "second"):
        monkeypatch.setenv("GIVEN", value)
        with ProcessPoolExecutor(1, contexts.get()) as pool:
            assert pool.submit(variables, ["GIVEN"]).result() == {"GIVEN": value}


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_workers_start_by_themselves_where_a_server_cannot_load_what_later_ones_need() -> None:
    contexts = ArrayContexts()
    for module, is_forked in (("wave", True), ("branchdrive.no_such_module", False), ("wave", False)):
        with ProcessPoolExecutor(1, contexts.get(module)) as pool:
            assert (pool.submit(who_i_am, 0).result()[1] != os.getpid()) == is_forked


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("threaded", "import threading, time; threading.Thread(target=time.sleep, args=[60], daemon=True).start()"),
        ("broken", "raise RuntimeError"),
        ("branchdrive", ""),
    ],
    ids=["has a thread", "cannot be loaded", "is another copy of the package"],
)
def test_workers_start_by_themselves_where_what_a_server_loads_is_not_fit_for_forks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, code: str
) -> None:
    (tmp_path / f"{name}.py").write_text(code)
    with monkeypatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        with array_context(name) as context:
            patch.undo()  # where they start by themselves, nothing of it is on their way
            with ProcessPoolExecutor(1, context) as pool:
                assert pool.submit(who_i_am, 0).result()[1] == os.getpid()


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_workers_start_by_themselves_where_their_server_was_killed() -> None:
    with array_context() as context:
        with ProcessPoolExecutor(1, context) as pool:
            server = pool.submit(who_i_am, 0).result()[1]
        os.kill(server, signal.SIGKILL)
        with ProcessPoolExecutor(1, context) as pool:
            assert pool.submit(who_i_am, 0).result()[1] == os.getpid()


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_an_interrupt_is_heard_while_a_server_loads_its_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, over = tmp_path / "begun", tmp_path / "over"
    code = f"import time; open({str(begun)!r}, 'w').close(); time.sleep(20); open({str(over)!r}, 'w').close()"
    (tmp_path / "slow.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    main = threading.main_thread().ident

    def interrupt() -> None:
        wait_for(begun.exists)
        signal.pthread_kill(main or 0, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell began the tests with &
    try:
        thread.start()
        with pytest.raises(KeyboardInterrupt), array_context("slow"):
            pass
        thread.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert not over.exists()


BESIDE = """
import sys
from pathlib import Path
from branchdrive import isolated, validate

if __name__ == "__main__":
    from branchdrive.runtime import executor  # what this process needs is loaded before the folder is infested
    from branchdrive.engine import derived, validate as _
    for name in ("json", "re", "pyarrow", "numpy", "branchdrive", "multiprocessing", "sitecustomize"):
        (Path(__file__).parent / f"{name}.py").write_text(f"open({sys.argv[2]!r} + '/{name}', 'w').close()")
    print(validate(sys.argv[1], executor=isolated(2)).exit_code)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="forked on Linux alone")
def test_workers_that_are_forked_import_nothing_from_the_folder_of_the_main_module(tmp_path: Path) -> None:
    for name in ("beside", "marks"):
        (tmp_path / name).mkdir()
    (tmp_path / "beside" / "script.py").write_text(BESIDE)
    done = subprocess.run(
        [sys.executable, tmp_path / "beside" / "script.py", datasets.write(tmp_path / "dataset"), tmp_path / "marks"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("0\n", "")
    assert marks(tmp_path / "marks") == []


UNGUARDED = """
import sys
from branchdrive import isolated, validate
print(*validate(sys.argv[1], executor=isolated(1)).errors)
"""


def test_a_script_without_a_guard_is_told_of_it_and_not_run_by_workers(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, tmp_path / "script.py", datasets.write(tmp_path / "dataset")],
        capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 0
    assert "needs the guard `if __name__ == '__main__':`" in done.stdout
