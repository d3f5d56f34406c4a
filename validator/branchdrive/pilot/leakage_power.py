"""Power of the leakage gate on a pilot's replays, and the groups that smaller effects need.

The standard error of a mean over ``n`` groups falls with their root, and so does the smallest offset that is found::

    groups for an offset d  ~  n (d_n / d)^2          with d_n the smallest offset found in n groups

A dozen groups are too few for that law, which is why they are repeated to about a hundred; rows are permuted within
each of them before an offset is planted, so that repetitions differ.

Source: spec/13-leakage.md; the extrapolation is this project's choice.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.text import NONE, counted
from branchdrive.leakage.gate import Gate, leakage_gate
from branchdrive.leakage.inputs import ReplayInputs, gate_features
from branchdrive.leakage.protocol import GateProtocol
from branchdrive.leakage.replays import inputs_of_facts
from branchdrive.leakage.scan import Layout
from branchdrive.leakage.sensitivity import Pattern
from branchdrive.leakage.table import rows_agree
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.text.table import Column, Table

__all__ = ["leakage_power"]

_TITLE = "Leakage"

_OFFSETS_SD = (0.1, 0.2, 0.4, 0.8)
"""Offsets that are planted into enough groups."""

_ENOUGH = 96
"""Groups from which on the law of the root holds well; fewer are repeated until there are as many."""

_POWER = GateProtocol(offsets_sd=_OFFSETS_SD, sparse_offsets_sd=(), num_permutations=5_999, num_replicates=3)
"""The fewest permutations with which the gate can fail, and few trials: a pilot's figures are rough."""

_WANTED_SD = (0.1, 0.2)
_SEED = 1

_PATTERN_TEXTS: dict[Pattern, str] = {
    "one": "one feature of one action",
    "dense": "a quarter of the features, by action",
}


def leakage_power(pilot: Pilot) -> Section:
    """The gate's verdict on the replays of the pilot, what it could have found, and what it will need."""
    if not pilot.rows:
        return Section("leakage", _TITLE, not_examined=[pilot.no_rows])
    inputs = _inputs(pilot)
    protocol = GateProtocol(offsets_sd=(), sparse_offsets_sd=())
    if inputs is None or inputs.num_groups < protocol.num_folds:
        count = 0 if inputs is None else inputs.num_groups
        return Section(
            "leakage", _TITLE,
            not_examined=[f"{counted(count, 'integrity-complete group')}; the gate needs {protocol.num_folds}"],
        )  # fmt: skip
    features, columns = gate_features(inputs)
    figures = {"groups": inputs.num_groups, "features": len(columns)}
    if rows_agree(features) and inputs.streams.are_identical:
        fact = (
            "All replays of every group are identical before the branch: nothing can tell which action follows, and "
            "power is no question as long as that stays so."
        )
        return Section("leakage", _TITLE, [fact], figures={**figures, "verdict": "pass", "bit_identical": True})
    gate = leakage_gate(features, seed=_SEED, protocol=protocol, layout=Layout.of(columns), streams=inputs.streams)
    facts = [
        f"The gate's verdict on {counted(inputs.num_groups, 'group')} and {len(columns)} features is {gate.verdict}: "
        f"{gate.reason}"
    ]
    concerns = []
    if gate.verdict == "fail":
        concerns.append(
            Concern(
                f"Replays tell before the branch which action follows: most of all {_strongest(gate, inputs)}.",
                "Look for what a replay knows of its action before t_b: its index in a shared random generator, the "
                "order of execution, or a command that acts too early.",
            )
        )
    table, smallest, num_groups = _power(pilot, features)
    not_examined = [
        f"an offset on {_PATTERN_TEXTS[pattern]}: not even {max(_OFFSETS_SD):g} standard deviations are found in "
        f"{counted(num_groups, 'group')}"
        for pattern in _PATTERN_TEXTS
        if smallest[pattern] is None
    ]
    return Section(
        "leakage", _TITLE, facts, concerns, [table], not_examined,
        {**figures, "verdict": gate.verdict, "bit_identical": False, "power_groups": num_groups,
         "smallest_sd": smallest},
    )  # fmt: skip


def _strongest(gate: Gate, inputs: ReplayInputs) -> str:
    """Where a gate that fails sees most: the action of a feature, or a recorded column."""
    columns = gate_features(inputs)[1]
    if gate.places and gate.places[0].p <= min(code.p for code in gate.codes):
        place = gate.places[0]
        key = inputs.action_keys[inputs.interventions[place.action]]
        return f"{columns[place.feature].name} of {key}, by {place.difference:+.2f} standard deviations"
    strongest = min(gate.codes, key=lambda code: code.p)
    streams = inputs.streams.columns
    names = [columns[i].name if i < len(columns) else streams[i - len(columns)].name for i in strongest.columns]
    return f"{' and '.join(names)}, over {counted(strongest.num_groups, 'group')}"


def _power(pilot: Pilot, features: NDArray[np.float64]) -> tuple[Table, dict[str, float | None], int]:
    """Smallest offsets found by pattern, as a table and alone, and the number of groups they were found in."""
    num_groups = len(features) * math.ceil(_ENOUGH / len(features))
    many = np.tile(features, (num_groups // len(features), 1, 1))
    effect = leakage_gate(many, seed=_SEED, protocol=_POWER).sensitivity
    rows = []
    smallest: dict[str, float | None] = {}
    for pattern in _PATTERN_TEXTS:
        found = None if effect is None else effect.smallest_sd(pattern)
        smallest[pattern] = found
        rows.append(
            [
                _PATTERN_TEXTS[pattern],
                _smallest_text(found),
                NONE if found is None else f"{found * math.sqrt(num_groups / pilot.num_wanted):.2g}",
                *(NONE if found is None else f"{_groups_for(num_groups, found, d):,}" for d in _WANTED_SD),
            ]
        )
    heads = [
        Column.name("Planted on"), Column(f"Found at {num_groups} groups, sd"),
        Column(f"At {pilot.num_wanted:,}, sd"), *(Column(f"Groups for {d:g} sd") for d in _WANTED_SD),
    ]  # fmt: skip
    note = (
        "The smallest planted offset that the gate finds in all of three trials, in standard deviations within groups. "
        f"{num_groups} groups are those of the pilot, repeated; other numbers follow by the root."
    )
    return Table("Power", heads, rows, [note]), smallest, num_groups


def _smallest_text(found: float | None) -> str:
    if found is None:
        return f"> {max(_OFFSETS_SD):g}"
    return f"{found:g}" if found > min(_OFFSETS_SD) else f"<= {found:g}"


def _groups_for(num_groups: int, found_sd: float, wanted_sd: float) -> int:
    return math.ceil(num_groups * (found_sd / wanted_sd) ** 2)


def _inputs(pilot: Pilot) -> ReplayInputs | None:
    """What the gate may see of all integrity-complete groups; ``None`` without any."""
    facts = pilot.rows["replays"]
    group_ids = facts["group_id"].tolist()
    if not group_ids:
        return None
    order = np.array(sorted(range(len(group_ids)), key=group_ids.__getitem__), np.intp)
    return inputs_of_facts(facts, order, ("pilot",) * len(order), pilot.descriptor)
