"""Rules TAB: tables are read into DuckDB, shard by shard, as far as they can be read (spec/03-layout.md)."""

import base64
import contextlib
import json
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import duckdb
import pyarrow as pa
from contract import LIMITS, RAW_TABLES, TABLES, TYPES, names_place
from layout import Folder, Location

TRAITS = ("unit", "frame", "shape", "track")


@dataclass
class Reading:
    """Locations that break the rules on tables, how many files each examined, and whether a shard was left out."""

    found: dict[str, list[Location]] = field(default_factory=dict)
    examined: Counter[str] = field(default_factory=Counter)
    is_whole: bool = True


def create(connection: duckdb.DuckDBPyConnection) -> None:
    """Creates the raw tables, empty, each with the shard of a row and the number of its attempt in the dataset.

    A row whose rollout is not in the rollouts table of its shard has no such number, and neither has a map.
    """
    for table in RAW_TABLES:
        columns = ", ".join(f"{column['name']} {TYPES[column['type']]}" for column in TABLES[table]["columns"])
        connection.execute(f"create or replace table {table} (shard varchar, run integer, {columns})")


def read(connection: duckdb.DuckDBPyConnection, folder: Folder, tables: list[str], *, is_claim: bool) -> Reading:
    """Reads tables of every shard; a shard with a table that cannot be read is left out as a whole.

    Unless they are a claim, those that are there are read, and none has to be.
    """
    judged = [number for number in range(1, 7) if is_claim or number != 4]
    reading = Reading({f"BD-TAB-{number:03}": [] for number in judged} | {"BD-LAY-007": []})
    shards = folder.shards
    reading.examined["BD-TAB-006"] = len(shards)
    if is_claim and not shards:
        reading.found["BD-TAB-004"].append({"file": "raw"})
    for shard in shards:
        paths = {table: f"{shard}/{table}.parquet" for table in tables}
        known = {*folder.kinds, *folder.manifest.digests}
        if is_claim:
            reading.found["BD-TAB-004"] += [{"file": path} for path in paths.values() if path not in known]
            reading.examined["BD-TAB-004"] += sum(path in folder.kinds or path not in known for path in paths.values())
        else:
            paths = {table: path for table, path in paths.items() if path in known}
        whole = True
        for table, path in paths.items():
            if folder.kinds.get(path) != "file":
                whole = False
                continue
            failures = _read_table(connection, table, str(folder.root / path))
            for rule, locations in failures.items():
                if rule != "BD-TAB-001" or path in folder.sound:  # another digest is blamed already
                    reading.found[rule] += [{"file": path, **location} for location in locations]
            decodes = not failures.keys() & {"BD-TAB-001", "BD-LAY-007"}
            reading.examined["BD-TAB-001"] += "BD-TAB-001" not in failures or path in folder.sound
            reading.examined.update(dict.fromkeys(("BD-TAB-002", "BD-TAB-003", "BD-TAB-005"), int(decodes)))
            whole &= not set(failures) & {"BD-TAB-001", "BD-TAB-002", "BD-LAY-007"}
        reading.is_whole &= whole or folder.kinds.get(shard) != "folder"
        if whole:
            for table in paths:
                connection.execute(f"insert into {table} by name select '{shard}' as shard, * from read_{table}")
    _number(connection, tables)
    return reading


def _number(connection: duckdb.DuckDBPyConnection, tables: list[str]) -> None:
    """Numbers the attempts, so that statements join on an integer."""
    connection.execute(
        "create or replace temp table numbered as select shard, rollout_id, row_number() over () as run "
        "from (select distinct shard, rollout_id from rollouts where rollout_id is not null)"
    )
    for table in tables:
        if any(column["name"] == "rollout_id" for column in TABLES[table]["columns"]):
            connection.execute(
                f"create or replace table {table} as select n.run, t.* exclude (run) from {table} t "
                "left join numbered n on n.shard = t.shard and n.rollout_id = t.rollout_id"
            )
    connection.execute(
        "create or replace table rollouts as select t.*, n.run as nominal_run from rollouts t "
        "left join numbered n on n.shard = t.shard and n.rollout_id = t.nominal_rollout_id"
    )


def _read_table(connection: duckdb.DuckDBPyConnection, table: str, file: str) -> dict[str, list[Location]]:
    """Decodes one file into the table `read_TABLE`; gives the places that break a rule."""
    try:
        ((rows,),) = connection.execute("select num_rows from parquet_file_metadata($file)", {"file": file}).fetchall()
        ((leaves,),) = connection.execute("select count(type) from parquet_schema($file)", {"file": file}).fetchall()
        metadata = connection.execute("select key, value from parquet_kv_metadata($file)", {"file": file}).fetchall()
        if rows > LIMITS["max_table_rows"] or leaves > LIMITS["max_table_columns"]:
            return {"BD-LAY-007": [{}]}
        connection.execute(
            f"create or replace temp table read_{table} as select * from read_parquet($file)", {"file": file}
        )
    except duckdb.Error:
        return {"BD-TAB-001": [{}]}
    found = {name: kind for name, kind, *_ in connection.execute(f"describe read_{table}").fetchall()}
    declared = {column["name"]: TYPES[column["type"]] for column in TABLES[table]["columns"]}
    wrong = [name for name in {**declared, **found} if declared.get(name) != found.get(name)]
    if wrong:
        return {"BD-TAB-002": [{"column": name} for name in wrong]}
    failures = {}
    if traits := _wrong_traits(table, metadata):
        failures["BD-TAB-003"] = traits
    if any(names_place(text.decode(errors="replace")) for pair in metadata for text in pair if not _is_schema(pair)):
        failures["BD-TAB-005"] = [{}]
    return failures


def _is_schema(pair: tuple[bytes, bytes]) -> bool:
    return pair[0] == b"ARROW:schema"


def _wrong_traits(table: str, metadata: list[tuple[bytes, bytes]]) -> list[Location]:
    """Units, frames, shapes and tracks that a file stores otherwise than declared, in either way of storing them."""
    declared = {
        column["name"]: {
            trait: f"[{', '.join(column[trait])}]" if trait == "shape" else column[trait]
            for trait in TRAITS
            if trait in column
        }
        for column in TABLES[table]["columns"]
    }
    found: list[Location] = []
    for key, value in metadata:
        stored: Any = {}
        if key == b"ARROW:schema":
            with contextlib.suppress(ValueError, pa.ArrowException):
                for column in pa.ipc.read_schema(pa.py_buffer(base64.b64decode(value))):
                    pairs = column.metadata or {}
                    texts = {trait: pairs[trait.encode()] for trait in TRAITS if trait.encode() in pairs}
                    stored[column.name] = {trait: text.decode(errors="replace") for trait, text in texts.items()}
        elif key == b"branchdrive.columns":
            try:
                for name, texts in json.loads(value).items():
                    stored[name] = {trait: texts[trait] for trait in TRAITS if trait in texts}
            except (ValueError, TypeError, AttributeError):
                found.append({})
        if any(stored.values()):
            found += [
                {"column": name}
                for name, traits in declared.items()
                for trait in TRAITS
                if stored.get(name, {}).get(trait) != traits.get(trait)
            ]
    return found
