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
from branchdrive.card.fidelity import fidelity_section
from branchdrive.card.front_matter import front_matter
from branchdrive.card.selected import ending_section, selected_section
from branchdrive.contract.columns import LAYER_TABLES, Table
from branchdrive.contract.descriptor import Descriptor, ReplayNoise, Vehicle
from branchdrive.contract.layer import LAYERS, paths_by_table, table_pattern
from branchdrive.contract.layout import FILTERING_FILE, LEAKAGE_FILE, RESULTS_FILE, SOURCE_FILE
from branchdrive.contract.text import count_text, counted, one_line, percent
from branchdrive.leakage.text import leakage_sentences
from branchdrive.quality.ledger import RELEASE_ACCESS, accesses
from branchdrive.quality.text import (
    PARTITION_TITLES,
    access_sentence,
    benchmark_sentences,
    calibration_sentences,
    population_sentences,
)
from branchdrive.text.markdown import grid
from branchdrive.text.table import Column

__all__ = ["ADDED", "REQUIRED", "release_card", "render_card"]

Document = Mapping[str, Any]

_QUALITY = ("population", "split", "thresholds", "retention", "ledger", "variants")

REQUIRED = {"source": SOURCE_FILE, **{name: f"quality/{name}.json" for name in _QUALITY}}
"""Documents that every card is made of: paths by the argument of `render_card`."""

ADDED = {"leakage": LEAKAGE_FILE, "filtering": FILTERING_FILE, "results": RESULTS_FILE}
"""Those that a release may do without."""

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


def release_card(descriptor: Descriptor, documents: Mapping[str, Any], files: Collection[str] = ()) -> str:
    """The card as Markdown.

    Args:
        descriptor: Of the release.
        documents: Its documents by path; others than `REQUIRED` and `ADDED` are not looked at.
        files: Paths of its files, of which those of optional tables count.
    """
    required = {name: documents[path] for name, path in REQUIRED.items()}
    added: dict[str, Any] = {name: documents.get(path) for name, path in ADDED.items()}
    optional = [name for name in paths_by_table(files) if LAYER_TABLES[name].optional]
    return render_card(descriptor, **required, **added, optional=optional)


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
    optional: Collection[str] = (),
) -> str:
    """The card as Markdown, of a release's descriptor and documents, and of the optional tables that it has.

    `leakage` is None where it was not audited, `filtering` where it was not recorded, `results` where no benchmark is
    published.
    """
    absent = {name for name, found in (("leakage.json", leakage), ("filtering.json", filtering)) if found is None}
    sections = [
        front_matter(descriptor, population, optional),
        _head(descriptor, population, ledger, leakage),
        _about(descriptor),
        _population(population),
        _attempts(source),
        _split(split),
        fidelity_section(thresholds, retention, ledger, filtering),
        ["## Action leakage", "", " ".join(leakage_sentences(leakage))],
        _variants(variants),
        *(section for section in (selected_section(results), ending_section(results)) if section),
        _structure(descriptor, source, optional, absent),
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


def _structure(descriptor: Descriptor, source: Document, there: Collection[str], absent: Collection[str]) -> list[str]:
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
        files += [_table_row(one) for one in layer.tables.values() if not one.optional or one.name in there]
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
