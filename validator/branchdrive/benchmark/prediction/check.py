"""What is wrong with tables of predictions: rows that belong nowhere, lack, repeat, or hold no number.

Source: paper, "Training and Test Locking"; spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.metric.outcome import MAX_MAGNITUDE
from branchdrive.benchmark.prediction.rows import COLUMNS, TABLES, Owner, PredictionRows
from branchdrive.benchmark.protocol.protocol import MAX_OWNERS, BenchmarkProtocol
from branchdrive.contract.mismatch import Location, Mismatch
from branchdrive.tables.frame import Frame

__all__ = ["mismatch_text", "prediction_mismatches"]


def mismatch_text(mismatch: Mismatch) -> str:
    """A mismatch of predictions as one line."""
    key = {name: value for name, value in mismatch.location.items() if name not in ("table", "column")}
    where = ", ".join(f"{name} {value!r}" for name, value in key.items())
    places = "".join(f"{place}: " for place in (f"table `{mismatch.location['table']}`", where) if place)
    return f"{places}expected {mismatch.expected}, found {mismatch.found}"


def prediction_mismatches(
    frames: Mapping[str, Frame], data: BenchmarkData, protocol: BenchmarkProtocol | None = None
) -> Iterator[Mismatch]:
    """What is wrong with the tables `TABLES`; at most one mismatch of a kind for each model, seed and table.

    The location of a mismatch has its table and the key of its row: what is not a number has its column too, seeds of a
    model have the model alone, and too many models and seeds have neither; nothing else is examined then.

    A partition is predicted where it has any row. With a protocol, its models have their seeds and predict every
    partition but the one they are fitted on, and any other model predicts the one that is reported.

    Args:
        frames: Rows of both tables, whose columns are those declared.
        data: The model layer.
        protocol: What the models are held to; only completeness by default.
    """
    places = {name: PredictionRows(frames[name], data) for name in TABLES}
    owners = {name: set(places[name].owners) for name in TABLES}
    for name in TABLES:
        if len(owners[name]) > MAX_OWNERS:
            expected = f"at most {MAX_OWNERS} pairs of a model and a seed"
            yield Mismatch({"table": name}, expected, f"{len(owners[name])} pairs")
            return
        models = {model for model, _ in owners[name]}
        problem = None if protocol is None else protocol.draws_problem(len(models), len(owners[name]))
        if problem is not None:
            expected = "no more models and seeds than the protocol's draws leave room for"
            yield Mismatch({"table": name}, expected, problem)
            return
    for owner in sorted(owners["predictions"] | owners["predicted_trajectories"]):
        partitions = {part for name in TABLES for part in places[name].partitions(owner)}
        partitions |= _wanted(owner, data, protocol)
        for name in TABLES:
            yield from _row_mismatches(places[name], owner)
            for partition in sorted(partitions):
                if protocol is not None and partition == protocol.partitions.fit:
                    yield from _fitted_on(places[name], owner, partition)
                else:
                    yield from _incomplete(places[name], owner, partition)
    if protocol is not None:
        yield from _seed_mismatches(owners["predictions"], protocol)


def _wanted(owner: Owner, data: BenchmarkData, protocol: BenchmarkProtocol | None) -> set[str]:
    if protocol is None:
        return set()
    names = (protocol.partitions.report,) if protocol.model(owner[0]) is None else protocol.predicted
    return {name for name in names if name in data.parts}


def _seed_mismatches(owners: set[Owner], protocol: BenchmarkProtocol) -> Iterator[Mismatch]:
    for model in protocol.models:
        seeds = {seed for name, seed in owners if name == model.id}
        if seeds != set(model.seeds):
            at: Location = {"table": "predictions", "model": model.id}
            yield Mismatch(at, f"seeds {sorted(model.seeds)}", f"seeds {sorted(seeds)}")


def _row_mismatches(table: PredictionRows, owner: Owner) -> Iterator[Mismatch]:
    """Rows of no group, of no candidate or step, and without a number; the first of each kind."""
    rows = table.of(owner)
    for row in rows[table.part[rows] < 0][:1].tolist():
        yield Mismatch(_place(table, owner, row), "a group of the model layer", "none of its groups")
    for row in rows[~table.is_known[rows]][:1].tolist():
        yield Mismatch(_place(table, owner, row), "a candidate and step of the bank", "neither")
    for column in COLUMNS[table.name]:
        values = np.ma.filled(np.ma.asarray(table.frame[column], np.float64), np.nan)[rows]
        for row in rows[~(np.abs(values) <= MAX_MAGNITUDE)][:1].tolist():
            at, found = _place(table, owner, row), str(table.frame[column][row])
            yield Mismatch({**at, "column": column}, f"a finite `{column}`", found)


def _fitted_on(table: PredictionRows, owner: Owner, partition: str) -> Iterator[Mismatch]:
    """The first row of a partition that is not predicted."""
    for row in table.of(owner, partition)[:1].tolist():
        yield Mismatch(_place(table, owner, row), f"a group outside of {partition!r}", f"one of {partition!r}")


def _incomplete(table: PredictionRows, owner: Owner, partition: str) -> Iterator[Mismatch]:
    """The first place of a partition without a row, and the first with several."""
    groups, keys = table.data.part(partition).groups, table.data.candidates
    counts = np.bincount(table.flat(owner, partition)[1], minlength=len(groups) * len(keys) * table.num_steps)
    for wrong, count in ((counts == 0, "no row"), (counts > 1, "several rows")):
        for place in np.flatnonzero(wrong)[:1].tolist():
            bank, step = divmod(place, table.num_steps)
            group, key = divmod(bank, len(keys))
            at: Location = {"table": table.name, "model": owner[0], "seed": owner[1], "group_id": groups[group]}
            at["action_key"] = keys[key]
            if table.num_steps > 1:
                at["step"] = step + 1
            yield Mismatch(at, "one row of this candidate", count)


def _place(table: PredictionRows, owner: Owner, row: int) -> Location:
    """Table and key of a row."""
    place: Location = {"table": table.name, "model": owner[0], "seed": owner[1]}
    place |= {name: str(table.frame[name][row]) for name in ("group_id", "action_key")}
    if "step" in table.frame:
        place["step"] = int(table.frame["step"][row])
    return place
