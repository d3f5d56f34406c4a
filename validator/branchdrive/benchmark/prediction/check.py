"""What is wrong with tables of predictions: rows that belong nowhere, lack, repeat, or hold no number.

Source: paper, "Training and Test Locking"; spec/14-benchmark.md#predictions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from branchdrive.benchmark.prediction.data import BenchmarkData
from branchdrive.benchmark.prediction.rows import STEPS, TABLES, Owner, PredictionRows
from branchdrive.benchmark.protocol.protocol import MAX_OWNERS, BenchmarkProtocol
from branchdrive.contract.mismatch import Location, Mismatch

__all__ = ["mismatch_text", "prediction_mismatches"]


def mismatch_text(mismatch: Mismatch) -> str:
    """A mismatch of predictions as one line."""
    key = {name: value for name, value in mismatch.location.items() if name not in ("table", "column")}
    where = ", ".join(f"{name} {value!r}" for name, value in key.items())
    places = "".join(f"{place}: " for place in (f"table `{mismatch.location['table']}`", where) if place)
    return f"{places}expected {mismatch.expected}, found {mismatch.found}"


def prediction_mismatches(rows: PredictionRows, protocol: BenchmarkProtocol | None = None) -> Iterator[Mismatch]:
    """What is wrong with the tables `TABLES`; at most one mismatch of a kind for each model, seed and table.

    The location of a mismatch has its table and the key of its row: what is not a number has its column too, seeds of a
    model have the model alone, and too many models and seeds have neither; nothing else is examined then.

    A partition is predicted where it has any row. With a protocol, its models have their seeds and predict every
    partition but the one they are fitted on, and any other model predicts the one that is reported.

    Args:
        rows: Rows of both tables, of which none was taken out.
        protocol: What the models are held to; only completeness by default.
    """
    for table, owners in rows.owners.items():
        if len(owners) > MAX_OWNERS:
            expected = f"at most {MAX_OWNERS} pairs of a model and a seed"
            yield Mismatch({"table": table}, expected, f"{len(owners)} pairs")
            return
        models = {model for model, _ in owners}
        problem = None if protocol is None else protocol.draws_problem(len(models), len(owners))
        if problem is not None:
            expected = "no more models and seeds than the protocol's draws leave room for"
            yield Mismatch({"table": table}, expected, problem)
            return
    for owner in sorted(set[Owner]().union(*rows.owners.values())):
        partitions = rows.partitions(owner) | _wanted(owner, rows.data, protocol)
        for table in TABLES:
            yield from rows.wrong[table].get(owner, {}).values()
            for partition in sorted(partitions):
                if protocol is not None and partition == protocol.partitions.fit:
                    yield from _fitted_on(rows, table, owner, partition)
                else:
                    yield from _incomplete(rows, table, owner, partition)
    if protocol is not None:
        yield from _seed_mismatches(rows.owners["predictions"], protocol)


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


def _fitted_on(rows: PredictionRows, table: str, owner: Owner, partition: str) -> Iterator[Mismatch]:
    """The first row of a partition that is not predicted."""
    first = rows.first[table].get(owner, {})
    if partition in first:
        yield Mismatch(first[partition], f"a group outside of {partition!r}", f"one of {partition!r}")


def _incomplete(rows: PredictionRows, table: str, owner: Owner, partition: str) -> Iterator[Mismatch]:
    """The first place of a partition without a row, and the first with several."""
    groups, keys, num_steps = rows.data.part(partition).groups, rows.data.candidates, STEPS[table]
    counts = rows.counts(table, owner, partition)
    for wrong, count in ((counts == 0, "no row"), (counts > 1, "several rows")):
        for place in np.flatnonzero(wrong)[:1].tolist():
            bank, step = divmod(place, num_steps)
            group, key = divmod(bank, len(keys))
            at: Location = {"table": table, "model": owner[0], "seed": owner[1], "group_id": groups[group]}
            at["action_key"] = keys[key]
            if num_steps > 1:
                at["step"] = step + 1
            yield Mismatch(at, "one row of this candidate", count)
