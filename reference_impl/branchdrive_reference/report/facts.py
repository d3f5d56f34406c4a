"""Everything that a report says of a dataset, read once: the validation, the study, the documents, every group.

Nothing is counted here. What a dataset holds is counted by `branchdrive_reference.study`, how far groups get by the
validator, and the population of a release by its own documents.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from branchdrive.card.card import ADDED, REQUIRED
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import parse_json, schema_mismatches
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import BENCHMARK, LATENCY_FILE, layer_of
from branchdrive.contract.limits import spec_limits
from branchdrive.contract.text import printable
from branchdrive.engine.group_result import GroupResult
from branchdrive.engine.reading import Progress
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.errors import DatasetError, UsageError
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.store import Store
from branchdrive.formats.table_file import read_layer_table
from branchdrive.raw.reader import Dataset, open_dataset
from branchdrive.raw.rollout import ROLLOUTS
from branchdrive.runtime.executor import Executor, in_process
from branchdrive_reference.report.fault import Fault, Faults
from branchdrive_reference.report.judgement import judged
from branchdrive_reference.report.scene import Scene, read_scene
from branchdrive_reference.report.shard_rows import ShardRows
from branchdrive_reference.study.label import label, sentence
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.survey import study_dataset

__all__ = ["DatasetReport", "GroupFacts", "Seen", "read_report", "scenes"]

_DOCUMENTS = (*REQUIRED.values(), *ADDED.values(), LATENCY_FILE)
"""Documents of a release that a report shows."""

_MOST_FIGURE_BYTES = 1_500_000
"""Of all figures of a benchmark together; more are named and not shown."""


@dataclass(frozen=True)
class GroupFacts:
    """What is known of a group beside its data.

    Attributes:
        group_id: As recorded.
        scenario_type: As recorded.
        town: As recorded.
        partition: Of the release; empty without one.
        result: How far it gets; ``None`` where the funnel is not judged.
    """

    group_id: str
    scenario_type: str
    town: str
    partition: str
    result: GroupResult | None

    @property
    def outcome(self) -> str:
        """Whether it qualifies, else what it is that it is lost for."""
        if self.result is None:
            return "not judged"
        return "qualifies" if self.result.qualifies else self.result.lacks


@dataclass(frozen=True)
class DatasetReport:
    """What a report says.

    Attributes:
        validation: The validator's report.
        dataset: The opened dataset with the raw layer; ``None`` where it cannot be.
        study: What it holds; ``None`` where that cannot be counted.
        not_studied: Why, one sentence.
        documents: Documents of the release, by path, each as its schema has it.
        figures: Figures of the published benchmark, by name.
        not_shown: What cannot be read or has no room, a sentence each.
        groups: Every group, in the order of the dataset.
    """

    validation: Report
    dataset: Dataset | None
    study: Study | None
    not_studied: str
    documents: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, bytes] = field(default_factory=dict)
    not_shown: Sequence[str] = ()
    groups: Sequence[GroupFacts] = ()

    @property
    def descriptor(self) -> Descriptor | None:
        """What the dataset says of itself."""
        return None if self.dataset is None else self.dataset.descriptor

    def to_json(self) -> dict[str, Any]:
        """Everything that is counted and judged, for programs."""
        return {
            "validation": self.validation.to_json(),
            "study": None if self.study is None else self.study.to_json(),
            "not_studied": self.not_studied,
            "documents": dict(self.documents),
            "not_shown": list(self.not_shown),
            "groups": [
                {
                    "id": group.group_id,
                    "scenario_type": group.scenario_type,
                    "town": group.town,
                    "partition": group.partition or None,
                    "outcome": group.outcome,
                }
                for group in self.groups
            ],
        }


def read_report(
    root: Place, *, raw: Place | None = None, executor: Executor = in_process, progress: Progress | None = None
) -> DatasetReport:
    """Validate the dataset at `root` and read what a report says of it, whatever is wrong with it.

    Args:
        root: The dataset: a folder, or where else one may be, see `open_store`.
        raw: The dataset with the raw layer, for a detached release.
        executor: How the validator runs shards.
        progress: Called after every shard that was validated.

    Raises:
        UsageError: There is no dataset at `root` or `raw`.
    """
    store, other = open_store(root), None if raw is None else open_store(raw)
    validation = validate(store, raw=other, executor=executor, progress=progress)
    source = other or store
    not_shown: list[str] = []
    dataset, study, not_studied = None, None, ""
    try:
        dataset = open_dataset(source)
    except (DatasetError, UsageError) as error:
        not_shown.append(sentence(error))
    try:
        study = study_dataset(source, lambda *_: None)
    except UsageError as error:
        not_studied = sentence(error)
    documents, figures, assignment = {}, {}, {}
    if dataset is not None:
        documents = _documents(store, not_shown)
        figures = _figures(store, not_shown)
        assignment = _assignment(store, not_shown) if "quality/split.json" in documents else {}
    groups = [] if dataset is None else list(_groups(dataset, validation, assignment))
    return DatasetReport(validation, dataset, study, not_studied, documents, figures, not_shown, groups)


def _documents(store: Store, not_shown: list[str]) -> dict[str, Any]:
    found = {}
    for path in _DOCUMENTS:
        try:
            if store.status(path) is None:
                continue
            document = parse_json(store.read(path, spec_limits().max_document_bytes))
        except (DatasetError, ValueError, RecursionError) as error:
            not_shown.append(sentence(error))
            continue
        declared = LAYERS[str(layer_of(path))].documents[path.partition("/")[2]]
        if schema_mismatches(document, declared.schema):
            not_shown.append(f"'{path}' is not shown: it does not conform to its schema.")
        else:
            found[path] = document
    return found


def _figures(store: Store, not_shown: list[str]) -> dict[str, bytes]:
    """Figures of the benchmark by name, as far as there is room."""
    place, found, num_bytes = f"{BENCHMARK}/figures", {}, 0
    try:
        names = sorted(name for name in store.names(place) if name.endswith(".png"))
    except DatasetError:
        return {}
    for name in names:
        try:
            content = store.read(f"{place}/{name}", _MOST_FIGURE_BYTES)
        except DatasetError as error:
            not_shown.append(sentence(error))
            continue
        num_bytes += len(content)
        if num_bytes > _MOST_FIGURE_BYTES:
            not_shown.append(f"Figure '{label(name)}' is not shown: figures have {_MOST_FIGURE_BYTES:,} bytes here.")
        elif content.startswith(b"\x89PNG\r\n\x1a\n"):
            found[name] = content
    return found


def _assignment(store: Store, not_shown: list[str]) -> dict[str, str]:
    """Partition of every group of a release."""
    try:
        rows = read_layer_table(store, "group_quality")
    except DatasetError as error:
        not_shown.append(sentence(error))
        return {}
    names, homes = (rows.column(name).to_pylist() for name in ("group_id", "partition"))
    return {str(name): home or "" for name, home in zip(names, homes, strict=True)}


def _groups(dataset: Dataset, validation: Report, assignment: Mapping[str, str]) -> Iterator[GroupFacts]:
    results = {result.group_id: result for result in validation.groups or ()}
    seen = set()
    for shard in dataset.shards:
        with suppress(DatasetError):  # a finding of the validator says so
            rows = shard.decode(ROLLOUTS).select(["group_id", "role", "scenario_type", "town"]).to_pylist()
            firsts: dict[str, dict[str, Any]] = {}
            for row in rows:
                if row["group_id"] not in firsts or row["role"] == "nominal":
                    firsts.setdefault(row["group_id"], row)
            for group_id, row in firsts.items():
                if group_id not in seen:
                    seen.add(group_id)
                    result = results.get(printable(group_id[:128]))
                    yield GroupFacts(group_id, row["scenario_type"], row["town"], assignment.get(group_id, ""), result)


class Seen(NamedTuple):
    """A group as it is read for its picture.

    Attributes:
        rows: Its shard.
        scene: What can be shown of it; that of a shard without a wanted group is empty.
        faults: What is wrong in it.
        is_judged: Whether rules judge the rows of the shard.
    """

    rows: ShardRows
    scene: Scene
    faults: Sequence[Fault] = ()
    is_judged: bool = False


def scenes(dataset: Dataset, wanted: frozenset[str], faults: Faults) -> Iterator[Seen]:
    """The wanted groups with the shard of each, one shard in memory at a time."""
    descriptor = dataset.descriptor
    for shard in dataset.shards:
        rows = ShardRows(shard, descriptor)
        records = rows.records()
        own: dict[str, list[int]] = {}
        for place, record in enumerate(records):
            if record["group_id"] in wanted:
                own.setdefault(record["group_id"], []).append(place)
        if not own:
            yield Seen(rows, Scene("", ()))
            continue
        judgement = judged(rows, descriptor)
        for group_id, places in own.items():
            chosen = None if judgement is None else judgement.chosen.get(group_id)
            marks = faults.marks(group_id, judgement)
            scene = read_scene(rows, records, places, descriptor.action_bank, chosen, marks)
            found = faults.of(scene, records, places, judgement)
            yield Seen(rows, scene, found, judgement is not None)
