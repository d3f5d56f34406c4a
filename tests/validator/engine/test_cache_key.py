"""Keys of a cache: any one input of a result changed gives another one, and where things lie gives none."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests import synthetic

from branchdrive.contract.descriptor import Descriptor
from branchdrive.engine.cache_key import Keys
from branchdrive.engine.cache_key import shard_key as key_of_shard
from branchdrive.engine.derived_rules import LayersTask, RawRows
from branchdrive.engine.shard import ShardTask
from branchdrive.engine.spool import Spool
from branchdrive.formats.folder import Folder

TASK = ShardTask(
    Folder(Path("a")), "raw/shard-00000", ("raw/shard-00000/rollouts.parquet",),
    Descriptor.model_validate(synthetic.descriptor()), frozenset({"BD-VAL-001", "BD-VAL-002"}), is_hashed=True,
)  # fmt: skip
DIGESTS = {"raw/shard-00000/rollouts.parquet": "0" * 64}
NAMES = ("canonical/records-00000.parquet", "quality/pairs-00000.parquet")
LAYERS = LayersTask(
    rules=("BD-CAN-001",), part=0, raw=RawRows(("raw-shard-00000",), ("records",), digest="d"), spool=Spool(Path("s")),
    descriptor=TASK.descriptor, tables=("records",), num_rows={"canonical/records-00000.parquet": 3},
    names=NAMES[:1], digests=dict.fromkeys(NAMES, "1" * 64),
    sizes={"benchmark/a.safetensors": 7}, broken={"BD-LYR-002": frozenset({"pairs"})},
    content={"canonical/records-00000.parquet": "2" * 64}, max_bytes=1 << 30,
)  # fmt: skip


def shard_key(task: ShardTask, digests: dict[str, str], by: str) -> str | None:
    about = Keys(by).of(task)
    return None if about is None else key_of_shard(about, digests)


def layers_key(task: LayersTask, raw_key: str | None, by: str) -> str | None:
    """Key of a task whose rows are all of shards with one key."""
    keys = Keys(by)
    for shard in task.raw.shards:
        keys.note(replace(TASK, folder=shard, spool=task.spool), raw_key)
    return keys.of(task)


NOT_OF_THE_KEY = {"dataset", "spool", "files"}
"""Where things lie; the files of a shard are in the key with their digests."""

texts = st.text(max_size=4)
OTHERS: dict[str, st.SearchStrategy[Any]] = {
    "folder": texts,
    "selected": st.frozensets(texts, min_size=1, max_size=3),
    "is_hashed": st.just(True),  # without digests, nothing is kept
    "optional": st.frozensets(texts, max_size=3),
    "media": st.sampled_from(["full", "sample", "index"]),
    "repeated_rollouts": st.frozensets(texts, max_size=3),
    "scattered_groups": st.frozensets(texts, max_size=3),
    "descriptor": st.sampled_from(
        [TASK.descriptor, Descriptor.model_validate({**synthetic.descriptor(), "title": "another"})]
    ),
    "rules": st.lists(texts, max_size=3).map(tuple),
    "part": st.none() | st.integers(0, 3),
    "tables": st.lists(texts, max_size=3).map(tuple),
    "names": st.lists(st.sampled_from(NAMES), max_size=3).map(tuple),
    "num_rows": st.dictionaries(texts, st.integers(0, 3), max_size=3),
    "sizes": st.dictionaries(texts, st.integers(0, 3), max_size=3),
    "digests": st.dictionaries(texts, texts, max_size=3).map(lambda drawn: drawn | LAYERS.digests),
    "content": st.dictionaries(texts, texts, max_size=3),
    "broken": st.dictionaries(texts, st.frozensets(texts, max_size=2), max_size=3),
    "max_bytes": st.integers(0, 3),
    "pieces_for": st.lists(texts, max_size=3).map(tuple),
    "parts": st.lists(st.integers(0, 3), max_size=3).map(tuple),
    "raw": st.builds(
        RawRows,
        st.lists(texts, max_size=2).map(tuple),
        st.lists(texts, max_size=2).map(tuple),
        st.booleans(),
        texts,
        st.none() | texts,
        st.sampled_from([None, TASK.descriptor]),
    ),
}
"""Other values of every field."""


def changed(task: Any) -> st.SearchStrategy[tuple[Any, Any]]:
    """A task with one field of the key drawn, and another with that field drawn once more."""
    names = sorted({one.name for one in fields(task)} - NOT_OF_THE_KEY)
    one_field = st.sampled_from(names).flatmap(lambda name: st.tuples(st.just(name), OTHERS[name], OTHERS[name]))
    return one_field.map(lambda drawn: (replace(task, **{drawn[0]: drawn[1]}), replace(task, **{drawn[0]: drawn[2]})))


@given(changed(TASK))
def test_any_other_field_of_a_shard_gives_another_key(pair: tuple[ShardTask, ShardTask]) -> None:
    one, other = (shard_key(task, DIGESTS, "i") for task in pair)
    assert None not in (one, other)
    assert (one == other) == (pair[0] == pair[1])


@given(changed(LAYERS))
def test_any_other_field_of_a_task_on_layers_gives_another_key(pair: tuple[LayersTask, LayersTask]) -> None:
    one, other = (layers_key(task, "k", "i") for task in pair)
    assert None not in (one, other)
    assert (one == other) == (pair[0] == pair[1])


@given(*(st.dictionaries(texts, texts, max_size=3) for _ in range(2)), texts, texts, st.booleans(), st.booleans())
def test_files_rows_and_installation_are_in_the_key(
    digests: Any, others: Any, by: str, other: str, has_rows: bool, has_others: bool
) -> None:
    with_rows = replace(TASK, spool=Spool(Path("x")))
    one = shard_key(with_rows if has_rows else TASK, digests, by)
    two = shard_key(with_rows if has_others else TASK, others, other)
    assert (one == two) == ((digests, by, has_rows) == (others, other, has_others))
    raw, another = ("-".join(sorted(each)) for each in (digests, others))
    assert (layers_key(LAYERS, raw, by) == layers_key(LAYERS, another, other)) == ((raw, by) == (another, other))


@pytest.mark.parametrize(
    "task",
    [
        replace(TASK, descriptor=None),
        replace(TASK, selected=frozenset()),
        replace(TASK, is_hashed=False),
        replace(LAYERS, names=("canonical/unread.parquet",)),
        replace(LAYERS, raw=RawRows(("raw-shard-00001",))),
        "another task",
    ],
)
def test_what_does_not_tell_all_its_inputs_has_no_key(task: Any) -> None:
    keys = Keys("i")
    keys.note(TASK, "k")
    keys.note(replace(TASK, folder="raw/shard-00001", spool=LAYERS.spool), None)
    assert keys.of(task) is None


def test_the_place_of_a_dataset_is_not_in_the_key() -> None:
    assert shard_key(replace(TASK, dataset=Folder(Path("b"))), DIGESTS, "i") == shard_key(TASK, DIGESTS, "i")
    assert layers_key(replace(LAYERS, spool=Spool(Path("t"))), "k", "i") == layers_key(LAYERS, "k", "i")
