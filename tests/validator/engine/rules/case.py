"""Registered cases of the rules: defects that one rule must find, and limits that it must still accept."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, TypeAlias

import pyarrow as pa
import pytest
from tests import synthetic, synthetic_map
from tests.audits import remembering
from tests.content_cache import kept, remembered
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.release import ReleaseDraft, detached_draft, release_draft

from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.report import Report
from branchdrive.engine.validate import validate
from branchdrive.formats.place import Place
from branchdrive.formats.untrusted_parquet import decode_table
from branchdrive.leakage.cells import Readings
from branchdrive.leakage.code import Answers, Code, Order, codes
from branchdrive.tables.content import table_digest

Edit: TypeAlias = Callable[[Any], object]
Base = Literal["full", "drives", "media", "map", "bare", "release", "detached", "alone", "benchmark"]
RELEASES: tuple[Base, ...] = ("release", "detached", "alone", "benchmark")

SHARD_0, SHARD_1 = synthetic.SHARDS

NOMINAL = "g0.nominal.a1"
REPLAY = "g0.nominal_replay.a1"
BRAKE = "g0.brake_0.50.a1"
ACCELERATE = "g0.accelerate_0.50.a1"
STEER_LEFT = "g0.steer_left_0.10.a1"
"""Attempts of the first group that cases edit."""

FURTHER = "g2.brake_0.50.a1"
"""An attempt of the other shard."""

BOTH = [BRAKE, FURTHER]
"""Attempts of two shards: one defect in several places is counted, however few of them a report keeps."""

INHERITED = frozenset({"BD-STA-001", "BD-CTL-009", "BD-EVD-001", "BD-BNK-001", "BD-GRP-003"})
"""Qualification rules that groups and attempts of the valid release fail, so that it has something to explain."""

NO_SUBJECT = frozenset(
    {
        "BD-ACT-005", "BD-ACT-006", "BD-ACT-007", "BD-CTL-015", "BD-DOC-006", "BD-FRM-013", "BD-LAY-010", "BD-LKG-017",
        "BD-MAP-009", "BD-MAP-011", "BD-MAP-012", "BD-RES-006", "BD-RPN-001", "BD-RPN-003", "BD-RPN-004", "BD-RPN-006",
        "BD-RSP-004", "BD-RSP-014", "BD-RSP-016",
    }
)  # fmt: skip
"""Rules without a subject: of actors that come back, of tracks that begin or end, in three groups or more, of archives,
which nothing holds, of an ignore file, which is not there, of codes, for which route clusters are too few, of towns
without signals, of lanes that meet and of stop lines, of one axis, exact replays and a vehicle, which nothing declares,
on red lights, which nobody runs, and on the first observation that differs, where attempts differ from the start."""

OF_MORE_GROUPS = frozenset({"BD-ACT-006", "BD-ACT-007"})
"""Those that have subjects in releases, whose groups are more."""

UNWRITTEN = frozenset({"BD-FID-013", "BD-BMK-016", "BD-MOD-022", "BD-MOD-023"})
"""Rules on documents and tables that a release may lack, and the drafts of releases do."""

RECOMMENDED = frozenset(rule_id for rule_id, rule in CATALOGUE.items() if rule.level == "SHOULD")
"""Rules whose failure decides nothing: a defect of another rule may well go against a recommendation too."""


@dataclass(frozen=True)
class Mutant:
    """One defect, and what exactly the validator must say about it.

    Attributes:
        rule: The rule that must fail, alone but for the consequences that the catalogue declares.
        name: Name of the defect, unique within its rule.
        edit: Puts the defect into a valid draft.
        base: Which valid dataset to spoil.
        at: Parts of the location that a finding of the rule must have.
        findings: Violating subjects of the rule.
        lost: Groups that the defect costs at the rule's stage; for qualification rules.
    """

    rule: str
    name: str
    edit: Edit
    base: Base
    at: dict[str, Any]
    findings: int
    lost: int

    @property
    def is_decisive(self) -> bool:
        """Whether the defect makes the dataset invalid."""
        return CATALOGUE[self.rule].decides

    @property
    def is_release(self) -> bool:
        """Whether it is a release, whose groups and attempts are not all good."""
        return self.base in RELEASES

    @property
    def may_fail(self) -> frozenset[str]:
        """The rule and its declared consequences."""
        return frozenset({self.rule, *CATALOGUE[self.rule].consequences})


@dataclass(frozen=True)
class Boundary:
    """A shape at the limit of what rules accept: nothing fails, and no group is lost.

    Attributes:
        rules: The rules whose limit it is.
        name: Name of the shape, unique.
        edit: Puts the shape into a valid draft.
        base: Which valid dataset to change.
        status: Status of the rules on it.
        verdict: Verdict on it.
    """

    rules: tuple[str, ...]
    name: str
    edit: Edit
    base: Base
    status: str
    verdict: str

    @property
    def is_release(self) -> bool:
        """Whether it is a release, whose groups and attempts are not all good."""
        return self.base in RELEASES


@dataclass
class Registry:
    """Cases in the order of their definition."""

    mutants: list[Mutant] = field(default_factory=list)
    boundaries: list[Boundary] = field(default_factory=list)


REGISTRY = Registry()


def mutant(
    rule: str,
    *,
    at: dict[str, Any] | None = None,
    base: Base | None = None,
    findings: int = 1,
    lost: int | None = None,
    name: str | None = None,
) -> Callable[[Edit], Edit]:
    """Register a function as a defect of `rule`; one of qualification costs one group unless `lost` differs.

    A rule on derived layers is broken in the release unless `base` differs.
    """

    def register(edit: Edit) -> Edit:
        cost = int(CATALOGUE[rule].kind == "qualification") if lost is None else lost
        label = name or edit.__name__.strip("_")
        assert all((label, rule) != (known.name, known.rule) for known in REGISTRY.mutants), f"{rule} {label} twice"
        REGISTRY.mutants.append(Mutant(rule, label, edit, base or _base_of(rule), at or {}, findings, cost))
        return edit

    return register


def boundary(
    *rules: str, base: Base | None = None, status: str = "pass", verdict: str = "valid", name: str | None = None
) -> Callable[[Edit], Edit]:
    """Register a function as a shape that `rules` must accept; a release without its raw layer is always `partial`."""

    def register(edit: Edit) -> Edit:
        assert set(rules) <= set(CATALOGUE), rules
        label = name or edit.__name__.strip("_")
        assert all(label != known.name for known in REGISTRY.boundaries), f"{label} twice"
        home = base or _base_of(rules[0])
        word = "partial" if home == "alone" else verdict
        REGISTRY.boundaries.append(Boundary(rules, label, edit, home, status, word))
        return edit

    return register


_BASES_OF_STREAMS: dict[str, Base] = {"map": "map", "decisions": "drives"}
"""Bases of rules on a stream that the others do not claim."""


def _base_of(rule: str) -> Base:
    for stream, base in _BASES_OF_STREAMS.items():
        if stream in CATALOGUE[rule].streams:
            return base
    bases: dict[str | None, Base] = {None: "full", "benchmark": "benchmark"}
    return bases.get(CATALOGUE[rule].layer, "release")


def new_draft(base: Base = "full") -> Draft:
    """A valid dataset to edit.

    It has actors and evidence, with media or maps too, or neither, or is one of drives; or it is a release with media
    in place, detached beside its raw dataset, or alone, or in place with a benchmark.
    """
    match base:
        case "full":
            return Draft(synthetic.base_tables(), synthetic.descriptor())
        case "drives":
            return Draft(synthetic.drives_tables(), synthetic.drives_descriptor())
        case "media":
            return Draft(synthetic.media_tables(), synthetic.media_descriptor())
        case "map":
            return Draft(synthetic_map.map_tables(), synthetic_map.map_descriptor())
        case "bare":
            return Draft(synthetic.bare_tables(), synthetic.bare_descriptor())
        case "release":
            return release_draft()
        case "benchmark":
            return BenchmarkDraft()
        case _:
            return detached_draft(with_raw=base == "detached")


def judged(draft: Draft, folder: Path) -> Report:
    """Report on a draft that is written into `folder`; its raw dataset is named where it has one beside it."""
    root = draft.write(folder / "dataset")
    return judged_folder(root, raw=draft.raw_root(root) if isinstance(draft, ReleaseDraft) else None)


def report_on(mutant: Mutant) -> Report:
    """Report on a valid dataset with a defect, which is judged once a checkout."""

    def judge() -> Report:
        draft = new_draft(mutant.base)
        mutant.edit(draft)
        with TemporaryDirectory() as folder:
            return judged(draft, Path(folder))

    return kept(f"mutant-{mutant.rule}-{mutant.name}", judge)


def judged_folder(root: Place, **options: Any) -> Report:
    """Report on the dataset at `root`; what was computed before of the same files is not computed again."""
    with pytest.MonkeyPatch.context() as patch:
        for place in PURE:
            module, name = place.rsplit(".", 1)
            patch.setattr(place, remembered(getattr(import_module(module), name)))
        patch.setattr("branchdrive.leakage.rules.codes.codes", _codes)
        patch.setattr("branchdrive.engine.derived_files.decode_table", _decoded)
        patch.setattr("branchdrive.engine.derived_files.table_digest", _digest)
        return validate(root, executor=remembering, **options)


PURE = (
    "branchdrive.engine.derived_files.schema_mismatches",
    "branchdrive.benchmark.protocol.rules.read_protocol",
    "branchdrive.benchmark.rules.results_document",
    "branchdrive.leakage.rules.codes.readings_of_history",
    "branchdrive.leakage.rules.structural.affine_targets",
    "branchdrive.leakage.rules.structural.neighbours_p",
    "branchdrive.leakage.rules.structural.ranked_targets",
    "branchdrive.leakage.rules.structural.revealed_outcomes",
    "branchdrive.leakage.rules.audit.score_mismatches",
    "branchdrive.leakage.rules.audit.statistic_mismatches",
    "branchdrive.files.survey.schema_mismatches",
    "branchdrive.benchmark.protocol.protocol.schema_mismatches",
    "branchdrive.leakage.battery.fit_logistic",
    "branchdrive.leakage.battery.held_out_score",
    "branchdrive.leakage.recompute._redrawn",
    "branchdrive.quality.retention._resampled_sums",
    "branchdrive.raw.media.image_eye.decode_image",
    "branchdrive.raw.media.image_eye.image_numbers",
)
"""Functions of their arguments alone that most of a judgement's time goes into.

Every rule runs on every case; what one of these said of equal arguments before is not computed again, since most
defects leave most tables and documents as they are.
"""


def _codes(columns: Iterable[tuple[Readings, Order | None]], asked: Sequence[Answers]) -> list[Code]:
    """Readings that are codes; of the same columns beside the same answers they are looked for once."""
    found: list[Code] = remembered(codes)([*columns], asked)
    return found


_tables: dict[tuple[bytes, str], pa.Table] = {}
"""Decoded tables, which nobody can change, by content and name."""


def _decoded(content: bytes, name: str) -> pa.Table:
    """Table of a derived layer; the same bytes are decoded once: most defects leave most tables as they are."""
    key = hashlib.sha256(content).digest(), name
    if key not in _tables:
        _tables[key] = decode_table(content, name)
    return _tables[key]


_digests: dict[int, str] = {}
"""Digests of the rows of decoded tables, which live as long as the process, by identity."""


def _digest(name: str, table: pa.Table) -> str:
    """Digest of a table of a derived layer; that of the same table is computed once."""
    if id(table) not in _digests:
        _digests[id(table)] = table_digest(name, table)
    return _digests[id(table)]
