"""The dataset card `README.md` of a release.

A card says what the documents of the release say, and what may not be concluded from them. It is a pure
function of those documents, so building a release again writes the same bytes.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" and "Discussion, Limitations, and Intended Use"
(limitations and intended use); spec/10-layers.md#card.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from itertools import pairwise
from typing import Any

from branchdrive.card.claims import EXCLUDED_CLAIMS, INTENDED_USES
from branchdrive.card.filtering import filtering_lines
from branchdrive.card.front_matter import front_matter
from branchdrive.card.selected import selected_section
from branchdrive.contract.columns import Table
from branchdrive.contract.descriptor import Descriptor, ReplayNoise, Vehicle
from branchdrive.contract.layer import LAYERS, table_pattern
from branchdrive.contract.text import count_text, counted, one_line, percent
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses
from branchdrive.quality.text import (
    PARTITION_TITLES,
    UNITS,
    access_sentence,
    benchmark_sentences,
    calibration_sentences,
    population_sentences,
    target_sentences,
    threshold_text,
)
from branchdrive.text.markdown import grid
from branchdrive.text.table import Column

__all__ = ["render_card"]

Document = Mapping[str, Any]

_DISPOSITIONS = {
    "selected": "stand for their group and action",
    "kept": "kept though ineligible: no complying attempt of their action exists",
    "replay": "replays of a nominal, from which the noise of replays is known",
    "partial": "ended before their last tick",
    "quarantined": "set aside by the collector",
    "outside_bank": "of an action that the bank does not have",
    "noncompliant": "violate a rule on attempts",
    "foreign_nominal": "executed against another nominal than the chosen one",
    "superseded": "duplicates or retries of a selected attempt",
}


def render_card(
    descriptor: Descriptor,
    source: Document,
    population: Document,
    split: Document,
    thresholds: Document,
    retention: Document,
    ledger: Document,
    variants: Document,
    leakage: Document | None = None,
    filtering: Document | None = None,
    results: Document | None = None,
) -> str:
    """The card as Markdown, of a release's descriptor and documents.

    `leakage` is None where it was not audited, `filtering` where it was not recorded, `results` where no benchmark is
    published.
    """
    absent = {name for name, found in (("leakage.json", leakage), ("filtering.json", filtering)) if found is None}
    sections = [
        front_matter(descriptor, population),
        _head(descriptor, population, ledger, leakage),
        _about(descriptor),
        _population(population),
        _attempts(source),
        _split(split),
        _fidelity(thresholds, retention, ledger, filtering),
        ["## Action leakage", "", " ".join(leakage_sentences(leakage))],
        _variants(variants),
        *([section] if (section := selected_section(results)) else []),
        _structure(descriptor, source, absent=absent),
        _use(),
        _validation(descriptor),
        _licence(descriptor),
    ]
    return "\n\n".join("\n".join(section) for section in sections) + "\n"


def _head(descriptor: Descriptor, population: Document, ledger: Document, leakage: Document | None) -> list[str]:
    lines = [f"# {_plain(descriptor.title)}"]
    if len(accesses(RELEASE_ACCESS, ledger)) > 1:
        lines += ["", f"> **Warning.** {access_sentence(ledger)}"]
    for sentence in benchmark_sentences(ledger):
        lines += ["", f"> **Warning.** {sentence}"]
    for sentence in population_sentences(population):
        lines += ["", f"> **Note.** {sentence}"]
    if leakage is not None and leakage["gate"]["verdict"] == "fail":
        lines += ["", f"> **Warning.** {leakage_sentences(leakage)[0]}"]
    return lines


def _about(descriptor: Descriptor) -> list[str]:
    bank = descriptor.action_bank
    interventions = len(bank.policies) - 1
    facts = {
        "Dataset": f"`{descriptor.dataset_id}` {descriptor.dataset_version}",
        "Specification": f"BranchDrive {descriptor.spec_version}",
        "Simulator": f"{_plain(descriptor.simulator.name)} {_plain(descriptor.simulator.version)}",
        "Collector": f"{_plain(descriptor.collector.name)} {_plain(descriptor.collector.version)}",
        "Action bank": f"`{bank.name}`, {len(bank.policies)} candidates",
        "Streams": ", ".join(f"`{name}`" for name in descriptor.streams),
        "Driver": _DRIVERS[descriptor.driver.kind] if descriptor.driver else "not declared",
        "Vehicle": _vehicle(descriptor.vehicle),
        "Not recorded": ", ".join(f"`{name}`" for name in descriptor.unrecorded) or "nothing; every column is recorded",
        "Replay noise": _noise(descriptor.collection.replay_noise),
        "Injected faults": _rates(descriptor.collection.faults),
        "Licence": _plain(descriptor.licence),
    }
    stated = {
        "Creators": ", ".join(map(_plain, descriptor.creators)),
        "Citation": _plain(descriptor.citation or ""),
        "DOI": _plain(descriptor.doi or ""),
        "Published at": _plain(descriptor.url or ""),
        "Keywords": ", ".join(map(_plain, descriptor.keywords)),
    }
    facts |= {title: text for title, text in stated.items() if text}
    return [
        *([_plain(descriptor.description), ""] if descriptor.description else []),
        "A branch-structured driving dataset.",
        f"A branch group is one moment of decision: one history that all candidates share, the nominal future of the "
        f"expert, and {interventions} futures in which an intervention was executed from that moment on.",
        "The complete branch group is the recommended unit of access.",
        "",
        *grid(_texts("Item", "Value"), facts.items()),
    ]


_DRIVERS = {"expert": "privileged expert", "log": "recorded log", "learned": "learned policy"}


def _vehicle(vehicle: Vehicle | None) -> str:
    """What is known of the vehicle, each part with what it is."""
    if vehicle is None:
        return "not declared"
    known = (
        ("wheelbase", vehicle.wheelbase_m, "m"),
        ("wheel angle at full steering", vehicle.max_steer_rad, "rad"),
        ("acceleration at full throttle", vehicle.max_accel_mps2, "m/s2"),
        ("deceleration at full brake", vehicle.max_decel_mps2, "m/s2"),
    )
    actuation = {None: "unknown", "pedals": "pedals of their own", "single_axis": "one axis"}[vehicle.actuation]
    numbers = (f"{name} {'unknown' if value is None else f'{value:g} {unit}'}" for name, value, unit in known)
    return "; ".join([*numbers, f"throttle and brake {actuation}"])


def _noise(noise: ReplayNoise) -> str:
    return noise.kind if noise.strength is None else f"{noise.kind}, strength {noise.strength:g}"


def _rates(faults: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {percent(rate)}" for name, rate in sorted(faults.items()) if rate) or "none"


def _population(population: Document) -> list[str]:
    names = population["partitions"]
    stages = population["stages"]
    rows = []
    for stage in stages:
        groups = stage["groups"]
        cells = [
            stage["title"],
            *(count_text(None if groups is None else groups.get(name)) for name in names),
            count_text(stage["total"]),
            count_text(stage["trajectories"]),
        ]
        rows.append([f"**{cell}**" for cell in cells] if stage["stage"] == "frozen" else cells)
    heads = [*(PARTITION_TITLES[name] for name in names), "Total groups", "Traj."]
    drops = [(before["total"] - after["total"], before, after) for before, after in pairwise(stages[:-2])]
    lost, before, after = max(drops, key=lambda drop: drop[0])
    lines = [
        "## Population",
        "",
        *grid([*_texts("Stage or population"), *map(Column, heads)], rows),
        "",
        "The frozen population is what benchmark results refer to: core replay-valid groups without near duplicates of "
        "another partition.",
        f"Trajectories are groups times {population['num_policies']} candidates; they are not independent samples.",
    ]
    if lost:
        lines.append(
            f"The largest loss is of {counted(lost, 'group')}, from *{_lower(before['title'])}* to "
            f"*{_lower(after['title'])}*."
        )
    return lines


def _attempts(source: Document) -> list[str]:
    records, states = source["records"], source["states"]
    rows = [
        [f"`{name}`", count_text(source["dispositions"][name]), text]
        for name, text in _DISPOSITIONS.items()
        if name in source["dispositions"]
    ]
    return [
        "## Attempts",
        "",
        f"{source['num_attempts']:,} attempts of {counted(source['num_groups'], 'group')} were audited, and the raw "
        "layer was left as it was.",
        "Every attempt has one disposition:",
        "",
        *grid([*_texts("Disposition"), Column("Attempts"), *_texts("Meaning")], rows),
        "",
        f"They give {sum(records.values()):,} canonical records, one for each group and action: "
        f"{records['physical']:,} physical, {records['nominal_link']:,} links to the nominal and "
        f"{records['missing']:,} missing.",
        f"Of these {states['selected']:,} are selected, {states['ineligible']:,} kept though ineligible.",
    ]


def _split(split: Document) -> list[str]:
    rows = [
        [
            PARTITION_TITLES[name],
            count_text(split["partitions"][name]["groups"]),
            count_text(split["partitions"][name]["clusters"]),
        ]
        for name in PARTITION_TITLES
        if name in split["partitions"]
    ]
    return [
        "## Split",
        "",
        f"Integrity-complete groups were divided with seed {split['seed']}, before any threshold was fitted.",
        f"Groups on the same route geometry form one of {split['num_clusters']:,} clusters and stay together, and "
        "scenario types are balanced.",
        *calibration_sentences(split),
        "Keep this split, or draw one that keeps whole groups and clusters together.",
        "",
        *grid([*_texts("Partition"), Column("Groups"), Column("Route clusters")], rows),
        "",
        f"Digest of the assignment: `{split['digest']}`.",
    ]


def _fidelity(thresholds: Document, retention: Document, ledger: Document, filtering: Document | None) -> list[str]:
    return [
        "## Replay fidelity",
        "",
        f"Every intervention replays its nominal up to the branch. The largest discrepancy of each variable must stay "
        f"within a threshold: the {percent(thresholds['quantile'], 0)} quantile (higher order statistic) over "
        f"{thresholds['num_groups']:,} structurally eligible training groups.",
        "",
        *grid(
            [*_texts("Variable", "Criterion"), Column("Threshold")],
            [[f"`{v['name']}`", v["criterion"], threshold_text(v, thresholds)] for v in thresholds["variables"]],
        ),
        "",
        *([] if filtering is None else filtering_lines(filtering)),
        f"Retention over all integrity-complete groups, with {percent(retention['level'], 0)} intervals over "
        f"{retention['num_resamples']:,} resamples of whole groups:",
        "",
        *grid(
            [
                *_texts("Criterion", "Partition", "Unit"),
                *map(Column, ("Passed", "Share", "Interval")),
                *_texts("Target"),
            ],
            [_retained(row) for row in retention["rows"]],
        ),
        "",
        *(f"On the test partition {sentence}" for sentence in target_sentences(retention)),
        access_sentence(ledger),
        *benchmark_sentences(ledger),
    ]


def _retained(row: Document) -> list[str]:
    share, interval, target = "-", "-", f"{percent(row['target'], 0)}, not judged"
    if None not in (row["share"], row["low"], row["high"]):
        share, interval = percent(row["share"]), f"{percent(row['low'])} to {percent(row['high'])}"
        target = f"{percent(row['target'], 0)}, {'met' if row['met'] else '**not met**'}"
    passed = f"{row['num_passed']:,} of {row['num_units']:,}"
    return [row["criterion"], PARTITION_TITLES[row["partition"]], UNITS[row["unit"]], passed, share, interval, target]


def _variants(variants: Document) -> list[str]:
    rows = [
        [f"`{v['name']}`", _plain(v["title"]), _where(v["where"]), count_text(v["num_groups"])]
        for v in variants["variants"]
    ]
    return [
        "## Other populations",
        "",
        f"The frozen population has {counted(variants['frozen']['num_groups'], 'group')}, digest "
        f"`{variants['frozen']['digest']}`.",
        "The following are other populations: report results on them separately, and never pool them with it.",
        "",
        *grid([*_texts("Name", "Title", "Flags"), Column("Groups")], rows),
    ]


def _where(where: Mapping[str, bool]) -> str:
    return ", ".join(f"`{name}`" if value else f"not `{name}`" for name, value in sorted(where.items()))


def _structure(descriptor: Descriptor, source: Document, *, absent: Collection[str]) -> list[str]:
    files = [["`branchdrive.json`", "Descriptor: what the dataset is and which streams and layers it claims."]]
    if "raw" in descriptor.layers:
        files.append(["`raw/`", "Every attempt as it was recorded, in shards of whole groups."])
    for name in descriptor.layers:
        if name not in LAYERS or name == "benchmark":  # results come later and leave the card as it is
            continue
        layer = LAYERS[name]
        files.append([f"`{name}/`", layer.title])
        files += [
            [f"`{name}/{document.name}`", document.title]
            for document in layer.documents.values()
            if document.name not in absent
        ]
        files += [_table_row(table) for table in layer.tables.values()]
    files.append(["`MANIFEST.sha256`", "Digest of every file."])
    lines = ["## Files", "", *grid(_texts("File", "Content"), files)]
    if "raw" not in descriptor.layers:
        lines += ["", f"This release is detached from its raw layer, whose digest is `{source['raw_layer']}`."]
    return lines


def _table_row(table: Table) -> list[str]:
    files = "" if not table.is_of_groups else ", in parts of each partition" if table.partitions else ", in parts"
    return [f"`{table_pattern(table.name)}`", f"{table.title} One row {table.rate}{files}."]


def _use() -> list[str]:
    return [
        "## Intended use",
        "",
        "This dataset is made for research. Use it to:",
        "",
        *(f"- {use}" for use in INTENDED_USES),
        "",
        "Keep availability masks, replay quality, provenance and exclusion flags with the values that they are about.",
        "",
        "## What must not be concluded",
        "",
        *(f"- **{claim}** {text}" for claim, text in EXCLUDED_CLAIMS),
    ]


def _validation(descriptor: Descriptor) -> list[str]:
    lines = [
        "## How to validate",
        "",
        "```",
        "branchdrive-validate PATH" if "raw" in descriptor.layers else "branchdrive-validate PATH --raw RAW",
        "```",
        "",
        "The validator recomputes what this card says and exits with 0 where all of it holds.",
        "Do not edit this file: what you want to add belongs into a file of its own that `.branchdriveignore` names.",
    ]
    if "raw" not in descriptor.layers:
        lines.append(
            "`RAW` is the dataset that holds the raw layer; without it, tables are only compared with each other."
        )
    return lines


def _licence(descriptor: Descriptor) -> list[str]:
    return [
        "## Licence",
        "",
        f"The data are licensed under {_plain(descriptor.licence)}, see `LICENCE.txt`.",
        "Software that reads or made them may be under another licence.",
    ]


def _texts(*titles: str) -> list[Column]:
    return [Column(title, is_text=True) for title in titles]


def _plain(text: str) -> str:
    """Free text on one line that Markdown shows as it is."""
    return re.sub(r"([\\`*_{}\[\]<>#|~&!])", r"\\\1", one_line(text))


def _lower(title: str) -> str:
    return title[0].lower() + title[1:]
