"""What tells branch groups apart before any of them is read: scenario, place, and what the quality layer says of them.

Source: spec/05-raw-streams.md#tables, spec/11-fidelity.md.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.resources import load_resource
from branchdrive.contract.text import nearest, quote
from branchdrive.errors import UsageError
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import read_layer_table
from branchdrive.raw.rollout import ROLLOUTS, canonical_key
from branchdrive.raw.shard import Shard

__all__ = ["QUALITY", "Context", "chosen_groups", "contexts_of_quality", "contexts_of_shard", "records_of"]

Context: TypeAlias = dict[str, Any]
"""Values of a group by column; a column that says nothing of it is ``None``."""

QUALITY = "group_quality"
"""Table that has a row for every group, with its partition."""


def contexts_of_shard(shard: Shard) -> dict[str, Context]:
    """Values that the attempts of each group of a shard share, by group id: those of its nominal, or of its first.

    Raises:
        DatasetError: The rollouts table is missing or does not decode.
    """
    shared = load_resource("columns.json")["records"]["branch_group"]["shared"]
    records = shard.decode(ROLLOUTS).select(["role", *shared]).to_pylist()
    found: dict[str, Context] = {}
    for record in sorted(records, key=lambda record: record["role"] != "nominal"):
        found.setdefault(record["group_id"], {name: record[name] for name in shared})
    return {group_id: found[group_id] for group_id in dict.fromkeys(record["group_id"] for record in records)}


def records_of(shards: Iterable[Shard], group_id: str, descriptor: Descriptor) -> list[Context]:
    """Rows of the rollouts table of a group, from the first shard that has any, in the order of its rollouts.

    Raises:
        DatasetError: A rollouts table is missing or does not decode.
    """
    for shard in shards:
        records = [record for record in shard.records() if record["group_id"] == group_id]
        if records:
            return sorted(records, key=lambda record: canonical_key(record, descriptor))
    return []


def contexts_of_quality(dataset: Store, descriptor: Descriptor) -> dict[str, Context]:
    """What the quality layer says of every group, by group id; nothing where none is claimed.

    Raises:
        DatasetError: The table cannot be read.
    """
    if "quality" not in descriptor.layers:
        return {}
    return {row["group_id"]: row for row in read_layer_table(dataset, QUALITY).to_pylist()}


def chosen_groups(contexts: Mapping[str, Context], wanted: Mapping[str, Any]) -> tuple[str, ...]:
    """Groups whose values are the wanted ones, or among them where several are wanted of a column.

    Raises:
        UsageError: No group has such a column, or none has such a text in it.
    """
    known = {name for context in contexts.values() for name in context}
    for name, values in wanted.items():
        if name not in known:
            raise UsageError(f"groups have no {quote(name)}; {_nearest_column(name, known)}")
        there = {context.get(name) for context in contexts.values()}
        for value in _several(values):
            if isinstance(value, str) and value not in there:
                texts = sorted(text for text in there if isinstance(text, str))
                raise UsageError(f"no group has {name} {quote(value)}; {nearest(value, texts)}")
    return tuple(
        group_id
        for group_id, context in contexts.items()
        if all(context.get(name) in _several(values) for name, values in wanted.items())
    )


def _several(values: Any) -> Sequence[Any]:
    return [values] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)


def _nearest_column(name: str, known: Collection[str]) -> str:
    of_quality = {column.name for column in LAYER_TABLES[QUALITY].columns}
    if name in of_quality:
        return "the quality layer of a release has it, and this dataset has none; run `branchdrive build`"
    return nearest(name, sorted(known))
