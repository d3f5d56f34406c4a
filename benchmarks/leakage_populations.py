"""Size of gate and battery on many small populations of a release in which nothing leaks.

Populations are 20 groups each, drawn without repetition until the groups of the release are used up, and then again
in another order. Nothing is permuted: what replays carry by themselves would show in p-values that are not uniform.
It takes about half an hour and is no part of the tests::

    python -m benchmarks.leakage_populations RELEASE [POPULATIONS]
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from branchdrive.engine.spool import Spool
from branchdrive.formats.folder import Folder
from branchdrive.leakage.battery import ways
from branchdrive.leakage.classifier import Unavailable, sequence_classifier
from branchdrive.leakage.gate import leakage_gate
from branchdrive.leakage.inputs import ReplayInputs, gate_features
from branchdrive.leakage.protocol import TESTS, BatteryProtocol, GateProtocol
from branchdrive.leakage.replays import replay_inputs
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.streams import Streams
from branchdrive.release.built_layers import load_layers
from branchdrive.release.scan import scan_raw
from branchdrive.runtime.executor import in_process
from branchdrive.statistics.random_words import orders, words
from branchdrive_reference.leakage.uniformity import uniformity

NUM_GROUPS = 20
_GATE = GateProtocol(num_permutations=199, offsets_sd=(), sparse_offsets_sd=())
_BATTERY = BatteryProtocol(num_permutations=199, num_resamples=1)
_HOMES = ("train",) * 12 + ("val",) * 4 + ("test",) * 4
_ORDER = "benchmarks/leakage-populations"


def populations(inputs: ReplayInputs, count: int) -> Iterator[ReplayInputs]:
    """Populations of `NUM_GROUPS` groups each, every group of a pass in one of them."""
    in_pass = inputs.num_groups // NUM_GROUPS
    for number in range(count):
        order = orders(words(1, _ORDER, 1, inputs.num_groups, first_row=number // in_pass))[0]
        first = number % in_pass * NUM_GROUPS
        yield chosen(inputs, order[first : first + NUM_GROUPS])


def chosen(inputs: ReplayInputs, rows: np.ndarray) -> ReplayInputs:
    """Some groups, the first of them for training, sorted by identity."""
    home = dict(zip(rows.tolist(), _HOMES, strict=True))
    kept = np.sort(rows)
    streams = inputs.streams
    arrays = {
        name: getattr(inputs, name)[kept]
        for name in ("availability", "discrepancy", "ego", "controls", "has_nominal_replay")
    }
    return replace(
        inputs,
        group_ids=tuple(inputs.group_ids[row] for row in kept.tolist()),
        partitions=tuple(home[row] for row in kept.tolist()),
        streams=Streams(streams.columns, streams.ranks[kept], streams.spread[kept]),
        **arrays,
    )


def p_values(inputs: ReplayInputs, seed: int) -> Iterator[tuple[str, float]]:
    """p-values of one population: statistics of the gate, then measures of the battery's tests."""
    features, columns = gate_features(inputs)
    gate = leakage_gate(features, seed=seed, protocol=_GATE, layout=Layout.of(columns), streams=inputs.streams)
    for test in gate.tests:
        yield f"gate {test.name}", test.p
    classifier = sequence_classifier()
    for way in ways(inputs):
        for part in way.parts(seed=seed, protocol=_BATTERY, classifier=classifier):
            if part.name in TESTS and part.compute is not None and not isinstance(classifier, Unavailable):
                score = part.compute()["score"]
                if not score["identical"]:
                    yield f"{way.name} {part.name} accuracy", score["p_accuracy"]
                    yield f"{way.name} {part.name} log-likelihood", score["p_log_likelihood"]


def report(inputs: ReplayInputs, count: int) -> None:
    """Print how far the p-values of each test are from uniform, and how many are small."""
    found: dict[str, list[float]] = defaultdict(list)
    for seed, population in enumerate(populations(inputs, count)):
        for name, p in p_values(population, seed):
            found[name].append(p)
    for name, values in found.items():
        small = ", ".join(f"{np.mean(np.array(values) <= level):.3f} at {level:g}" for level in (0.01, 0.05, 0.1))
        fit = uniformity(values)
        sys.stdout.write(f"{name:40} {len(values):4} D {fit.distance:.3f} p {fit.p:.3f}; at most: {small}\n")


def main(root: Path, count: int) -> None:
    """Read the release and report."""
    dataset = Folder.at(root)
    with Spool.temporary() as spool:
        scan = scan_raw(dataset, spool, in_process)
        inputs = replay_inputs(scan.rows["replays"], load_layers(dataset).rows("group_quality"), scan.descriptor)
    report(inputs, count)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 200)
