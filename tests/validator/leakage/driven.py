"""Inputs of an audit that follow from recorded drives, and what a process finds in them.

Run as a module it is one processor: it audits the drives into a document, or judges one that is there::

    python -m tests.validator.leakage.driven DOCUMENT
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.driving.discrepancy import History, core_discrepancy
from branchdrive.leakage.audit import SeenInputs, audit_of
from branchdrive.leakage.classifier import Unavailable
from branchdrive.leakage.draw import KeptHere
from branchdrive.leakage.gate import dealt
from branchdrive.leakage.inputs import ReplayInputs, gate_features
from branchdrive.leakage.protocol import AuditProtocol, BatteryProtocol, GateProtocol
from branchdrive.leakage.recompute import input_mismatches, score_mismatches, statistic_mismatches
from branchdrive.leakage.replays import EGO_NAMES, ego_frames
from branchdrive.leakage.table import tabulate
from branchdrive.leakage.verify import battery_mismatches, count_mismatches, gate_mismatches
from branchdrive.quality.retention import retention
from branchdrive.statistics.random_words import normals, words

PROTOCOL = AuditProtocol(
    GateProtocol(alpha=0.05, num_permutations=199, offsets_sd=(0.2, 0.8), num_replicates=2),
    BatteryProtocol(num_permutations=199, num_resamples=200),
)
NUM_GROUPS, NUM_ACTIONS = 45, 5


def driven_inputs() -> ReplayInputs:
    """Replays recorded in the frame of the world; half of them repeat their drive in every bit."""

    def drawn(name: str, *shape: int) -> Any:
        return normals(words(0, name, 1, 3 * int(np.prod(shape)))).reshape(shape)

    rows = (NUM_GROUPS, NUM_ACTIONS)
    differs = drawn("differs", *rows, 1) > 0
    noise = 1e-3 * differs

    def columns(name: str, num_ticks: int, size: float, centre: float = 0.0) -> Any:
        drive = centre + size * drawn(name, NUM_GROUPS, 1, num_ticks).cumsum(axis=2)
        return (drive + noise * drawn(name + "/noise", *rows, num_ticks)).astype(np.float32).astype(np.float64)

    x, y, yaw = columns("x", 17, 1.0, 2e3), columns("y", 17, 1.0, -4e3), columns("yaw", 17, 0.3)
    speed, controls = columns("speed", 17, 0.1, 8.0), [columns(name, 80, 0.01) for name in ("steer", "gas", "brake")]
    pose = np.stack([field[:, 0, -1] for field in (x, y, yaw)], axis=1)
    fields = [*(field[..., 1:] for field in (x, y, yaw, speed)), *controls]
    flat = [field.reshape(NUM_GROUPS * NUM_ACTIONS, -1) for field in fields]
    nominal = [np.broadcast_to(f[:, :1], f.shape).reshape(NUM_GROUPS * NUM_ACTIONS, -1) for f in fields]
    ticks = np.zeros(NUM_GROUPS * NUM_ACTIONS)
    core = core_discrepancy(History(*flat, ticks), History(*nominal, ticks)).reshape(*rows, -1)
    return ReplayInputs(
        group_ids=tuple(f"g{index:03d}" for index in range(NUM_GROUPS)),
        partitions=tuple(("train", "test", "val")[index % 3] for index in range(NUM_GROUPS)),
        action_keys=tuple("abcde"),
        nominal_index=0,
        availability_names=("controls",),
        ego_names=EGO_NAMES,
        control_names=("steer", "throttle", "brake"),
        availability=np.ones((*rows, 1)),
        discrepancy=np.concatenate([core, np.zeros((*rows, 5))], axis=2),
        ego=ego_frames(x, y, yaw, speed, pose),
        controls=np.stack(controls, axis=3),
        has_nominal_replay=np.ones(NUM_GROUPS, np.bool_),
    )


def audited(inputs: ReplayInputs) -> dict[str, Any]:
    """The document of an audit without recurrent tests."""
    return audit_of(
        KeptHere(inputs), SeenInputs.of(inputs), seed=5, protocol=PROTOCOL,
        sequence_classifier=Unavailable("not installed"),
    )  # fmt: skip


def mismatches(document: dict[str, Any], inputs: ReplayInputs) -> list[str]:
    """Places of a document that do not follow from inputs."""
    found = [*count_mismatches(document), *gate_mismatches(document), *battery_mismatches(document)]
    for judge in (input_mismatches, statistic_mismatches, score_mismatches):
        found += judge(document, inputs)
    return [f"{m.location['pointer']}: expected {m.expected}, found {m.found}" for m in found]


def main(path: Path) -> None:
    """Write the document if it is not there, and print what this process finds."""
    inputs = driven_inputs()
    if not path.exists():
        path.write_bytes(dump_json(audited(inputs)))
    document = parse_json(path.read_bytes())
    table = tabulate(dealt(gate_features(inputs)[0], 5))
    passed = np.arange(12) < 13 - np.arange(90)[:, None] % 7
    counts = np.stack([passed.sum(axis=1), np.full(90, 12)], axis=1)
    bounds = [(row.low, row.high) for row in retention(counts, ["train"] * 90, partitions=["train"], seed=1)]
    exact = {"digest": inputs.digest(), "steps": table.steps.tobytes().hex(), "retention": bounds}
    sys.stdout.write(json.dumps({"mismatches": mismatches(document, inputs), "exact": exact}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
