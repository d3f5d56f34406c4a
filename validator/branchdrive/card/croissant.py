"""A dataset as Croissant, the JSON-LD by which search engines, hubs and loaders know it.

One record set for each table, or for each of its partitions, with a field for every column. A record set reads its only
file, whose digest loaders check, or a file set, a pattern of paths below the document, where there are several.
The document is a function of the descriptor and the manifest: it knows no date, and equal datasets have equal bytes.

Source: Croissant 1.1 and its RAI vocabulary 1.0, mlcommons.org/croissant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from branchdrive.card.claims import EXCLUDED_CLAIMS, INTENDED_USES
from branchdrive.card.licence import licence_urls
from branchdrive.contract.columns import LAYER_TABLES, TABLES, Column, Table, declared_table
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import table_file, table_pattern
from branchdrive.contract.layout import RAW_DIR, shard_index

__all__ = ["croissant"]

Json = dict[str, Any]

_CONFORMS_TO = ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"]
_PARQUET = "application/x-parquet"
_CR = (
    "arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract", "field", "fileProperty",
    "fileObject", "fileSet", "format", "includes", "isArray", "isLiveDataset", "jsonPath", "key", "md5", "parentField",
    "path", "recordSet", "references", "regex", "repeated", "replace", "samplingRate", "separator", "source",
    "subField", "transform",
)  # fmt: skip
"""Terms of the vocabulary that the standard context shortens."""

_CONTEXT: Json = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{term: f"cr:{term}" for term in _CR},
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "sc": "https://schema.org/",
}
_DATA_TYPES = {
    "string": "sc:Text", "bool": "sc:Boolean", "int32": "sc:Integer", "int64": "sc:Integer", "float32": "sc:Float",
    "float64": "sc:Float", "list<float64>": "sc:Float",
}  # fmt: skip


def croissant(descriptor: Descriptor, files: Mapping[str, str]) -> Json:
    """The document of a dataset.

    Args:
        descriptor: What it is.
        files: SHA-256 of its files by path, as its manifest lists them.
    """
    tables = _files_of_tables(descriptor, files)
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": _CONFORMS_TO,
        **_about(descriptor),
        "distribution": [*_distribution(tables, files)],
        "recordSet": [_record_set(table, partition, paths) for (table, partition), paths in tables.items()],
    }


def _about(descriptor: Descriptor) -> Json:
    """What it is, and what may be concluded from it."""
    made = f"{descriptor.collector.name} {descriptor.collector.version}"
    world = f"{descriptor.simulator.name} {descriptor.simulator.version}"
    about = {
        "name": descriptor.dataset_id,
        "alternateName": descriptor.title,
        "description": descriptor.description or descriptor.title,
        "version": descriptor.dataset_version,
        "license": licence_urls(descriptor.licence) or [descriptor.licence],
        "url": descriptor.url or (descriptor.doi and f"https://doi.org/{descriptor.doi}"),
        "sameAs": descriptor.doi and f"https://doi.org/{descriptor.doi}",
        "citeAs": descriptor.citation,
        "keywords": [*descriptor.keywords],
        "creator": [{"@type": "sc:Organization", "name": name} for name in descriptor.creators],
        "isLiveDataset": False,
        "rai:dataCollection": f"Driven in simulation, {world}, and recorded by {made}.",
        "rai:dataCollectionMissingData": ", ".join(descriptor.unrecorded) or None,
        "rai:dataUseCases": [f"Use it to {use}." for use in INTENDED_USES],
        "rai:dataLimitations": [" ".join(claim) for claim in EXCLUDED_CLAIMS],
    }
    return {name: value for name, value in about.items() if value not in (None, [])}


def _files_of_tables(descriptor: Descriptor, files: Mapping[str, str]) -> dict[tuple[Table, str | None], Sequence[str]]:
    """Paths of the files of every table and partition, in the order of tables and of rows."""
    found: dict[tuple[str, str | None], list[str]] = {}
    for path in sorted(files):
        folder, _, rest = path.partition("/")
        shard, _, name = rest.partition("/")
        if folder == RAW_DIR and shard_index(shard) is not None and name.removesuffix(".parquet") in descriptor.tables:
            found.setdefault((name.removesuffix(".parquet"), None), []).append(path)
        elif (file := table_file(path)) is not None:
            found.setdefault((file.table, file.partition), []).append(path)
    order = [(name, part) for name in (*TABLES, *LAYER_TABLES) for part in declared_table(name).partitions or (None,)]
    return {(declared_table(key[0]), key[1]): found[key] for key in order if key in found}


def _distribution(tables: Mapping[tuple[Table, str | None], Sequence[str]], files: Mapping[str, str]) -> Iterator[Json]:
    for (table, partition), paths in tables.items():
        for path in paths:
            yield {
                "@type": "cr:FileObject", "@id": path, "name": path, "contentUrl": path, "encodingFormat": _PARQUET,
                "sha256": files[path],
            }  # fmt: skip
        if len(paths) > 1:
            yield {
                "@type": "cr:FileSet", "@id": f"files/{_name(table, partition)}", "name": _name(table, partition),
                "encodingFormat": _PARQUET, "includes": _pattern(table, partition),
            }  # fmt: skip


def _record_set(table: Table, partition: str | None, paths: Sequence[str]) -> Json:
    name = _name(table, partition)
    source = {"fileObject": {"@id": paths[0]}} if len(paths) == 1 else {"fileSet": {"@id": f"files/{name}"}}
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": table.title + (f" Partition {partition}." if partition else ""),
        "key": [{"@id": f"{name}/{column}"} for column in table.key],
        "field": [_field(name, column, source) for column in table.columns],
    }


def _field(record_set: str, column: Column, source: Json) -> Json:
    about = {"unit": column.unit, "frame": column.frame, "track": column.track}
    facts = "".join(f" {name.capitalize()}: {text}." for name, text in about.items() if text)
    shape = {"isArray": True, "arrayShape": "-1"} if column.type.startswith("list") else {}
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{column.name}",
        "name": column.name,
        "description": column.description + facts,
        "dataType": _DATA_TYPES[column.type],
        **shape,
        "source": {**source, "extract": {"column": column.name}},
    }


def _name(table: Table, partition: str | None) -> str:
    return table.name + (f"-{partition}" if partition else "")


def _pattern(table: Table, partition: str | None) -> str:
    return f"{RAW_DIR}/shard-*/{table.file_name}" if table.name in TABLES else table_pattern(table.name, partition)
