"""Cases say the same in every place: in memory, in a bucket, in an archive, from a cache, and by processes of a pool.

`make thorough` judges a tenth of them in all of these, and larger datasets; `make test` judges one case in each, and
`make ray` a tenth on Ray.
"""

from __future__ import annotations

import hashlib
import io
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import obstore
import pytest
from benchmarks.repeated import repeat_dataset
from obstore.store import MemoryStore
from tests.bucket_server import BucketServer, serving, use
from tests.mutation import new_draft
from tests.places import files_of, packed
from tests.sampling import THOROUGH
from tests.validator.engine.rules.case import judged_folder

from branchdrive.cli.main import run
from branchdrive.engine.cache import Cache
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.engine.waiver import load_waivers
from branchdrive.formats.place import Place, open_store
from branchdrive.runtime.executor import isolated
from branchdrive_conformance.case import Case, cases_dir, load_cases
from branchdrive_conformance.materialize import DATASET_DIR, RAW_DIR, WAIVERS_FILE, materialize
from branchdrive_reference.collect.campaign import collect

KINDS = ("memory", "bucket", "archive", "cache", "pool")
EVERY, FEW = 10, 120


@pytest.fixture(scope="module")
def server() -> Iterator[BucketServer]:
    with serving() as running, pytest.MonkeyPatch.context() as patch:
        use(running, patch)
        yield running


def drawn(case: Case) -> int:
    """A number of a case that changes with its name alone."""
    return int.from_bytes(hashlib.sha256(case.name.encode()).digest()[:4])


def has_equal(root: Path) -> bool:
    """Whether other places than folders can hold what lies there: no link, no special file, no empty folder."""
    paths = [*root.rglob("*")]
    is_plain = all(not path.is_symlink() and (path.is_file() or path.is_dir()) for path in paths)
    return is_plain and all(any(path.iterdir()) for path in paths if path.is_dir())


def at(kind: str, root: Path, server: BucketServer) -> Place:
    """The dataset of a case in a place of a kind; cache and pool are of the folder itself."""
    match kind:
        case "memory":
            memory = MemoryStore()
            for path, content in files_of(root).items():
                obstore.put(memory, path, content)
            return open_store(memory)
        case "bucket":
            server.objects.clear()
            server.fill(root, "case")
            return "s3://bucket/case"
        case "archive":
            return packed(root, root.with_suffix(".zip"))
    return root


def told(report: Report) -> dict[str, Any]:
    """What a report says, but for where the dataset is and what of it an earlier run said."""
    found = report.to_json()
    found["conditions"] = [line for line in found["conditions"] if "earlier run" not in line]
    del found["dataset"]["path"]
    return {**found, "cached": None}


def options_of(case: Case, folder: Path) -> dict[str, Any]:
    """Options of the validation of a case, whose files are in a folder."""
    return {
        "raw": folder / RAW_DIR if case.raw is not None else None,
        "waivers": load_waivers(folder / WAIVERS_FILE) if "waivers" in case.options else (),
        "hash_files": case.options.get("hash", True),
    }


def compare(case: Case, folder: Path, kinds: Sequence[str], server: BucketServer) -> int:
    """Judge a case in its folder and in other places, and see that it is the same; the places that were tried."""
    materialize(cases_dir(), case, folder)
    root = folder / DATASET_DIR
    if not has_equal(root):
        return 0
    compare_folder(root, kinds, server, case.name, **options_of(case, folder))
    return len(kinds)


def compare_folder(root: Path, kinds: Sequence[str], server: BucketServer, name: str, **options: Any) -> Report:
    """Judge a folder and what equals it in other places, and see that it is the same; the report on the folder."""
    report = judged_folder(root, **options)
    expected = told(report)
    for kind in kinds:
        if kind == "pool":
            assert told(validate(root, executor=isolated(2), **options)) == expected, (name, kind)
            continue
        caches: tuple[Cache | None, ...] = (None,)
        if kind == "cache":
            kept = Cache(root.parent / "cache")
            caches = (kept, kept) if options.get("hash_files", True) else ()
        for cache in caches:
            assert told(judged_folder(at(kind, root, server), cache=cache, **options)) == expected, (name, kind)
    return report


def test_some_cases_say_the_same_in_a_place_each(server: BucketServer, tmp_path: Path) -> None:
    tried: Counter[str] = Counter()
    for case in load_cases(cases_dir()):
        if drawn(case) % FEW == 0:
            kind = KINDS[drawn(case) // FEW % len(KINDS)]
            if not tried[kind]:
                tried[kind] += compare(case, tmp_path / "case", (kind,), server)
                shutil.rmtree(tmp_path / "case")
    assert tried == dict.fromkeys(KINDS, 1)


@THOROUGH
def test_a_tenth_of_the_cases_say_the_same_everywhere(server: BucketServer, tmp_path: Path) -> None:
    for case in load_cases(cases_dir()):
        if drawn(case) % EVERY == 0:
            compare(case, tmp_path / "case", KINDS, server)
            shutil.rmtree(tmp_path / "case")


def demo(folder: Path) -> Path:
    """The dataset of `make demo`, a release without its audit of leakage, whose permutations take minutes."""
    root = folder / "dataset"
    for arguments in (("collect", "--preset", "demo", "--groups", 29, "--seed", 1), ("build", "--no-leakage")):
        assert run([arguments[0], str(root), *map(str, arguments[1:])], io.StringIO(), io.StringIO()) == 0
    return root


def collection(folder: Path) -> Path:
    """A collection of 64 groups in 8 shards; since two are repeated, rules find copies."""
    collect(folder / "source", num_groups=2, seed=7)
    repeat_dataset(folder / "source", folder / "dataset", num_groups=64, groups_per_shard=8)
    return folder / "dataset"


def benchmark(folder: Path) -> Path:
    """A release with a benchmark."""
    return new_draft("benchmark").write(folder / "dataset")


@THOROUGH
@pytest.mark.parametrize("made", [demo, collection, benchmark])
def test_larger_datasets_say_the_same_everywhere(
    made: Callable[[Path], Path], server: BucketServer, tmp_path: Path
) -> None:
    report = compare_folder(made(tmp_path), KINDS, server, made.__name__)
    assert report.verdict == ("invalid" if made is collection else "valid")
