"""Results of earlier runs: taken where everything is equal, never where anything is not, and told of."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import date
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from tests import synthetic
from tests.audits import remember_audits, validate_once
from tests.validator.engine.datasets import DEPARTURES, OTHER_FOLDER, cells, write, write_with
from tests.validator.engine.rules.release import release_draft

from branchdrive.cli.main import run
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import schema_mismatches
from branchdrive.contract.rule import CATALOGUE, RULES
from branchdrive.engine import cache as cache_module
from branchdrive.engine.cache import Cache, CacheUse, caching
from branchdrive.engine.cached_task import CachedTask, _is_drawn
from branchdrive.engine.report import Report
from branchdrive.engine.shard import ShardTask
from branchdrive.engine.stored_result import from_bytes, to_bytes
from branchdrive.engine.tally import Tally
from branchdrive.engine.validate import validate
from branchdrive.errors import UsageError
from branchdrive.formats.folder import Folder
from branchdrive.formats.private_folder import PrivateFolder
from branchdrive.runtime.executor import Died, Failed, in_process, isolated

DAY = date(2026, 5, 4).toordinal()


class Counting:
    """Executor in this process that counts audits and tasks on derived layers which are not taken from a cache."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.num_shards = self.num_layer_tasks = 0
        from branchdrive.engine import derived, reading

        audit, judge = reading.audit_shard, derived.judge_part

        def counted_audit(task: Any) -> Any:
            self.num_shards += 1
            return audit(task)

        def counted_judge(task: Any) -> Any:
            self.num_layer_tasks += 1
            return judge(task)

        monkeypatch.setattr(reading, "audit_shard", counted_audit)
        monkeypatch.setattr(derived, "judge_part", counted_judge)


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Counting:
    return Counting(monkeypatch)


def without_cache(report: Report) -> str:
    """A report as bytes, but for what says that a cache was used."""
    document = report.to_json()
    used = set() if report.cached is None else {*report.cached.conditions(report.dataset.num_shards)}
    document["conditions"] = [line for line in document["conditions"] if line not in used]
    return json.dumps({**document, "cached": None}, sort_keys=True)


SITUATIONS: dict[str, Callable[[Path], Path]] = {
    "valid": write,
    "media": lambda root: write(root, synthetic.media_tables(), synthetic.media_descriptor()),
    "bare": lambda root: write(root, synthetic.bare_tables(), synthetic.bare_descriptor()),
    "invalid": lambda root: write(root, DEPARTURES["speed out of range"].tables()),
    "repeated attempts": lambda root: write(
        root, {**synthetic.base_tables(), "raw/shard-00002": synthetic.base_tables()[OTHER_FOLDER]}
    ),
    "release": lambda root: release_draft().write(root),
}


@pytest.mark.parametrize("name", SITUATIONS)
def test_reports_with_a_cache_say_what_those_without_one_say(name: str, tmp_path: Path, counting: Counting) -> None:
    root, cache = SITUATIONS[name](tmp_path / "dataset"), Cache(tmp_path / "cache")
    expected = without_cache(validate_once(root))
    filling = validate(root, cache=cache)
    assert without_cache(filling) == expected
    assert filling.cached == CacheUse()
    counting.num_shards = counting.num_layer_tasks = 0
    taking = validate(root, cache=cache)
    assert without_cache(taking) == expected
    assert (counting.num_shards, counting.num_layer_tasks) == (0, 0)
    assert taking.cached is not None
    assert len(taking.cached.shards) == taking.dataset.num_shards
    assert (taking.cached.num_layer_tasks > 0) == (name == "release")
    assert schema_mismatches(json.loads(json.dumps(taking.to_json())), "report.schema.json") == []
    again = validate(root, cache=replace(cache, recheck=1.0))
    assert without_cache(again) == expected
    assert again.cached is not None and again.cached.num_rechecked >= len(again.cached.shards)


def test_the_pool_takes_and_keeps_what_this_process_does(tmp_path: Path, counting: Counting) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    filling = validate(root, cache=cache, executor=isolated(2))
    assert counting.num_shards == 0
    taking = validate(root, cache=cache)
    assert counting.num_shards == 0
    assert without_cache(taking) == without_cache(filling)
    assert taking.cached is not None and len(taking.cached.shards) == 2


def test_a_changed_shard_alone_is_judged_again(tmp_path: Path, counting: Counting) -> None:
    cache = Cache(tmp_path / "cache")
    validate(write(tmp_path / "before"), cache=cache)
    counting.num_shards = 0
    changed = write(tmp_path / "elsewhere", cells("observations", "speed_mps", {3: 1000.0}))
    report = validate(changed, cache=cache)
    assert counting.num_shards == 1
    assert report.cached is not None and report.cached.shards == {OTHER_FOLDER}
    assert without_cache(report) == without_cache(validate(changed))
    assert report.verdict == "invalid"


def test_reports_say_who_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remember_audits(monkeypatch)
    root = write(tmp_path / "dataset")
    arguments = ["validate", str(root), "--cache", str(tmp_path / "cache")]
    line = "2 of 2 shards judged by an earlier run of version"
    for form, is_said in (("text", False), ("text", True), ("markdown", True), ("github", True), ("sarif", True)):
        stdout = StringIO()
        assert run([*arguments, "--format", form], stdout, StringIO()) == 0
        assert (line in " ".join(stdout.getvalue().split())) == is_said, form
    stdout = StringIO()
    run([*arguments, "--format", "json", "--recheck", "1"], stdout, StringIO())
    document = json.loads(stdout.getvalue())
    version = document["validator_version"]
    assert document["cached"] == {
        "shards": 2, "by_version": 0, "layer_tasks": 0, "versions": [version], "rechecked": 2, "damaged": 0,
        "unasked": 0,
    }  # fmt: skip
    assert document["conditions"][-1] == f"{line} {version}; 2 of these judged again"


def entries(cache: Cache) -> list[Path]:
    return sorted(Path(cache.path).iterdir())


DAMAGES: dict[str, Callable[[Path, Path], object]] = {
    "a bit is another": lambda one, _: one.write_bytes(bytes([one.read_bytes()[0] ^ 1]) + one.read_bytes()[1:]),
    "the last bit is another": lambda one, _: one.write_bytes(one.read_bytes()[:-1] + b"\xff"),
    "cut off": lambda one, _: one.write_bytes(one.read_bytes()[:-1]),
    "empty": lambda one, _: one.write_bytes(b""),
    "another entry": lambda one, other: shutil.copy(other, one),
    "a link": lambda one, other: (one.unlink(), one.symlink_to(other)),
    "a folder": lambda one, _: (one.unlink(), one.mkdir()),
    "a pipe": lambda one, _: (one.unlink(), os.mkfifo(one)),
    "a pickle": lambda one, _: one.write_bytes(b"\x80\x04cos\nsystem\n."),
    "no bytes of a result": lambda one, _: PrivateFolder(one.parent).put(one.stem, b"[1, 2"),
    "another value": lambda one, _: PrivateFolder(one.parent).put(one.stem, to_bytes([1])),
    "another result": lambda one, _: PrivateFolder(one.parent).put(
        one.stem, to_bytes({"version": "1", "result": Tally("BD-VAL-001"), "rows": {}})
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_none(damage: str, tmp_path: Path, counting: Counting) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    expected = without_cache(validate(root, cache=cache))
    DAMAGES[damage](*entries(cache))
    counting.num_shards = 0
    report = validate(root, cache=cache)
    assert counting.num_shards == 1
    assert without_cache(report) == expected
    assert report.cached is not None and report.cached.num_damaged == 1
    assert report.conditions[-1] == "1 damaged file in the cache, whose tasks were judged again"
    if damage != "a folder":
        assert validate(root, cache=cache).cached == CacheUse(
            {"raw/shard-00000", OTHER_FOLDER}, versions={report.validator_version}
        )


def test_what_differs_when_it_is_judged_again_is_a_failure_that_names_the_entry(tmp_path: Path) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    validate(root, cache=cache)
    liar = entries(cache)[0]
    folder = PrivateFolder.at(cache.path)
    content = folder.get(liar.stem)
    assert content is not None
    value = from_bytes(content)
    value["result"].num_missing_attempts = 7
    folder.put(liar.stem, to_bytes(value))
    assert validate(root, cache=cache).dataset.num_missing_attempts == 7  # whoever can write in it is believed
    stdout = StringIO()
    code = run(["validate", str(root), "--cache", str(cache.path), "--recheck", "1"], stdout, StringIO())
    report = validate(root, cache=replace(cache, recheck=1.0))
    assert (code, report.verdict, report.dataset.num_missing_attempts) == (4, "error", 0)
    (message,) = report.errors
    assert liar.stem in message and "has other num_missing_attempts: it differs" in message
    assert liar.stem in stdout.getvalue().replace("\n", "")


def test_every_day_others_are_judged_again() -> None:
    keys = [f"{number:064x}" for number in range(400)]

    def drawn(day: int, share: float) -> set[str]:
        once = CachedTask(len, (), PrivateFolder(Path()), "run", False, share, day, None)
        return {key for key in keys if _is_drawn(once, key)}

    assert drawn(DAY, 0.0) == set() and drawn(DAY, 1.0) == {*keys}
    assert drawn(DAY, 0.1) < drawn(DAY, 0.2)
    days = [drawn(DAY + number, 0.1) for number in range(60)]
    assert 30 < sum(map(len, days)) / len(days) < 50
    assert len(set.union(*days)) > 390
    assert drawn(DAY, 0.1) == days[0]


def test_failures_and_what_cannot_be_read_are_never_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counting: Counting
) -> None:
    cache = Cache(tmp_path / "cache")
    undecodable = write_with(tmp_path / "undecodable", {"raw/shard-00001/actors.parquet": b"PAR1"})
    validate(undecodable, cache=cache)
    assert len(entries(cache)) == 1
    with monkeypatch.context() as patch:
        patch.setitem(RULES, "BD-VAL-001", lambda *_: 1 / 0)
        assert validate(write(tmp_path / "failing"), cache=cache, ignore=["BD-VAL-003"]).verdict == "error"
        assert len(entries(cache)) == 1
        # Rules that are not asked for fail, too: rows of derived layers rest on all of them.
        release, asked = release_draft().write(tmp_path / "release"), ["BD-LAY", "BD-CAN"]
        validate(release, cache=cache, select=asked)
    report = validate(release, cache=cache, select=asked)
    assert report.cached == CacheUse()


def test_deaths_are_never_kept(tmp_path: Path) -> None:
    folder, use = PrivateFolder.at(tmp_path / "cache"), CacheUse()

    def deadly(function: Any, tasks: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        yield from [(0, Died()), (1, Failed("no"))]

    root = write(tmp_path / "dataset")
    executor = caching(deadly, Cache(folder.path), folder, use, day=1)
    assert dict(executor(len, [shard_task(root), shard_task(root)])) == {0: Died(), 1: Failed("no")}
    assert (list(folder.path.iterdir()), use) == ([], CacheUse())


def shard_task(root: Path) -> ShardTask:
    files = tuple(f"raw/shard-00000/{path.name}" for path in sorted((root / "raw/shard-00000").iterdir()))
    described = Descriptor.model_validate(synthetic.descriptor())
    return ShardTask(Folder(root), "raw/shard-00000", files, described, frozenset(CATALOGUE), is_hashed=True)


def test_a_file_that_changes_while_it_is_judged_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from branchdrive.engine import reading

    root, cache, audit = write(tmp_path / "dataset"), Cache(tmp_path / "cache"), reading.audit_shard
    other = write(tmp_path / "other", cells("observations", "speed_mps", {3: 1000.0}))

    def exchanged(task: Any) -> Any:
        shutil.copytree(other, root, dirs_exist_ok=True)
        return audit(task)

    with monkeypatch.context() as patch:
        patch.setattr(reading, "audit_shard", exchanged)
        validate(root, cache=cache)
    assert len(entries(cache)) == 1  # the other shard has the same bytes
    assert validate(write(tmp_path / "again"), cache=cache).verdict == "valid"


def test_a_cache_does_not_serve_every_validation(tmp_path: Path) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    for options, reason in (
        ({"strict": True}, "a strict validation takes nothing"),
        ({"hash_files": False}, "goes by the digests of files"),
        ({"ignore": ["BD-LAY-002"]}, "leave BD-LAY-002 in"),
    ):
        with pytest.raises(UsageError, match=reason):
            validate(root, cache=cache, **options)
    with pytest.raises(UsageError, match="lies inside the dataset"):
        validate(root, cache=Cache(root / "cache"))
    assert not (root / "cache").exists() and not Path(cache.path).exists()
    with pytest.raises(UsageError, match="not a share"):
        Cache(tmp_path, recheck=1.5)
    for arguments in (["--recheck", "0.1"], ["--cache", str(tmp_path / "c"), "--recheck", "2"]):
        stderr = StringIO()
        assert run(["validate", str(root), *arguments], StringIO(), stderr) == 2
        assert "--recheck" in stderr.getvalue()


@pytest.mark.parametrize("is_of_another_user", [False, True])
def test_a_folder_that_others_can_write_in_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_of_another_user: bool
) -> None:
    folder = tmp_path / "cache"
    folder.mkdir(0o700)
    if is_of_another_user:
        monkeypatch.setattr("os.geteuid", lambda: os.getuid() + 1)
    else:
        folder.chmod(0o750)
    with pytest.raises(UsageError, match="chmod 700"):
        validate(write(tmp_path / "dataset"), cache=Cache(folder))


def test_a_cache_has_a_bound_and_keeps_what_was_used_last(tmp_path: Path) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    validate(root, cache=cache)
    old, recent = entries(cache)
    os.utime(old, (1, 1))
    left_over = old.with_name("tmp1234.partial")
    left_over.write_bytes(b"of a run that was killed")
    os.utime(left_over, (2, 2))
    other = old.with_name("notes.txt")
    other.write_bytes(b"of somebody" * 10_000)
    PrivateFolder.at(cache.path).prune(recent.stat().st_size)
    assert entries(cache) == sorted([recent, other])
    assert validate(root, cache=replace(cache, max_bytes=1)).cached is not None
    assert entries(cache) == [other]


def fill(task: tuple[Path, Path]) -> str:
    """Validate with a cache, in a process of a pool."""
    root, folder = task
    return without_cache(validate(root, cache=Cache(folder)))


def test_two_runs_share_a_cache(tmp_path: Path) -> None:
    root, folder = write(tmp_path / "dataset"), tmp_path / "cache"
    reports = dict(isolated(2)(fill, [(root, folder)] * 2))
    assert reports[0] == reports[1] == without_cache(validate(root))
    assert [path.suffix for path in folder.iterdir()] == [".entry"] * 2


def test_another_installation_takes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counting: Counting
) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    validate(root, cache=cache)
    monkeypatch.setattr(cache_module, "installation_digest", lambda: "another")
    counting.num_shards = 0
    assert validate(root, cache=cache).cached == CacheUse()
    assert counting.num_shards == 2
    assert len(entries(cache)) == 4


def test_other_options_take_nothing(tmp_path: Path) -> None:
    root, cache = write(tmp_path / "dataset"), Cache(tmp_path / "cache")
    validate(root, cache=cache)
    for options in ({"media": "index"}, {"ignore": ["BD-VAL-001"]}, {"select": ["BD-LAY", "BD-VAL"]}):
        assert validate(root, cache=cache, **options).cached == CacheUse()


def test_nothing_of_where_a_dataset_lies_is_kept(tmp_path: Path) -> None:
    release_draft().write(tmp_path / "somewhere-of-my-own")
    cache = Cache(tmp_path / "cache")
    validate(tmp_path / "somewhere-of-my-own", cache=cache)
    assert entries(cache)
    for path in entries(cache):
        assert b"somewhere-of-my-own" not in path.read_bytes()


def test_executors_are_left_what_is_no_task_of_a_validation(tmp_path: Path) -> None:
    executor = caching(in_process, Cache(tmp_path / "cache"), PrivateFolder.at(tmp_path / "cache"), CacheUse(), day=1)
    assert dict(executor(abs, [-1, -2])) == {0: 1, 1: 2}
