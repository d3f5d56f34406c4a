"""Table of how long selectors take.

Source: spec/14-benchmark.md#latency.
"""

from __future__ import annotations

from branchdrive.benchmark.latency import WAYS
from branchdrive.benchmark.table.cell import Document
from branchdrive.contract.columns import STREAMS
from branchdrive.contract.text import NONE, counted
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.text.table import Column, Table

__all__ = ["latency_table"]

_FIGURES = ("median_ms", "quantile_95_ms")
_CAMERAS = len(STREAMS["rgb_surround"].cameras)


def latency_table(latency: Document) -> Table:
    """Median and 95 % quantile of every model.

    Args:
        latency: Document ``latency.json``, which conforms to its schema.
    """
    rows = [
        [entry["model"], str(entry["num_seeds"]), *(_cell(entry[way], name) for way in WAYS for name in _FIGURES)]
        for entry in latency["models"]
    ]
    machine, software = latency["machine"], latency["software"]
    processor = machine["processor"] or "a processor without a name"
    versions = ", ".join(f"{name} {software[name]}" for name in sorted(software))
    notes = [
        f"Time to rank {latency['num_candidates']} candidates of one context with all seeds of a model, over "
        f"{counted(latency['num_repeats'], 'ranking')}: the networks in torch, and the model exported to ONNX.",
        f"Measured on one machine and not recomputed by a validator: {processor} ({machine['architecture']}), "
        f"device {machine['device']}, {counted(machine['num_threads'], 'thread')}; {versions}.",
    ]
    if seeing := [entry["model"] for entry in latency["models"] if "reads_cameras" in entry]:
        notes.append(
            f"{', '.join(seeing)}: torch decodes and encodes the {_CAMERAS * HISTORY_OBSERVATIONS} images of a window, "
            f"and its seeds run one after another; ONNX takes the {_CAMERAS} of a new observation and what it kept of "
            "those before, all seeds at once."
        )
    columns = [
        Column.name("Model"), Column("Seeds"), Column("torch: median, ms"), Column("torch: 95 %, ms"),
        Column("ONNX: median, ms"), Column("ONNX: 95 %, ms"),
    ]  # fmt: skip
    return Table("Latency", columns, rows, notes)


def _cell(found: Document | None, name: str) -> str:
    return NONE if found is None else f"{found[name]:.2f}"
