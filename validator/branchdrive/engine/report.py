"""The report: everything a validation found out, as data. Source: spec/07-rules.md#report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from branchdrive.contract.columns import DECISIONS
from branchdrive.contract.descriptor import Tolerances
from branchdrive.contract.media import MEDIA_MODES, MediaMode
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted, listed, quote
from branchdrive.engine.cache import CacheUse
from branchdrive.engine.cause import NO_CAUSES, Causes
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.group_result import GroupResult
from branchdrive.engine.response_summary import ResponseSummary
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import Verdict
from branchdrive.engine.waiver import WaiverOutcome
from branchdrive.exit_code import EXIT_FAILED, EXIT_INVALID, EXIT_OF_VERDICT
from branchdrive.raw.funnel import Funnel
from branchdrive.tables.data_frame import to_pandas
from branchdrive.text.html import html_of
from branchdrive.text.table import Column, Table

__all__ = ["FUNNEL_BASIS", "POPULATION_BASIS", "DatasetFacts", "Report", "RunOptions"]

_FRAME = (
    ("rule", "string"), ("kind", "string"), ("group_id", "string"), ("location", "string"), ("count", "int64"),
    ("expected", "string"), ("found", "string"), ("message", "string"), ("remedy", "string"), ("waived", "bool_"),
)  # fmt: skip
"""Columns of the findings as a data frame."""

FUNNEL_BASIS = "recomputed from the raw layer"
POPULATION_BASIS = "claimed by the release, recomputed from its stored tables alone"


@dataclass(frozen=True)
class DatasetFacts:
    """What was validated.

    `raw_path` is ``None`` unless the raw layer lies elsewhere. `identity` and `descriptor_digest` are computed from the
    digests of this run, and `content_identity` from what the data say, with the digest of each layer in `content`;
    ``None`` where digests were not computed. `tolerances` are those that the descriptor declares or leaves at their
    defaults, by name, `replay_noise` is the declared kind, `unrecorded` are the columns that it lists, and
    `unclaimed_streams` those of branch groups that it leaves out; empty without a usable descriptor.
    `num_missing_attempts` counts those that lack among the numbers of the others. `num_groups` is 0 where attempts are
    drives. `num_beside` counts names in the folder that are no part of the dataset.
    """

    path: str
    raw_path: str | None
    dataset_id: str | None
    dataset_version: str | None
    identity: str | None
    descriptor_digest: str | None
    tolerances: dict[str, float]
    replay_noise: str | None
    unrecorded: list[str]
    unclaimed_streams: list[str]
    num_missing_attempts: int
    content_identity: str | None
    content: dict[str, str]
    num_shards: int
    num_files: int
    num_beside: int
    num_bytes: int
    num_groups: int
    num_rollouts: int
    rows: dict[str, int]


@dataclass(frozen=True)
class RunOptions:
    """How it was validated; `links` are the folders that links may lead into, ``None`` where none is followed."""

    selected: tuple[str, ...] | None
    ignored: tuple[str, ...]
    hashed: bool
    require_groups: int | None
    is_strict: bool = False
    links: tuple[str, ...] | None = None
    media: MediaMode = "full"


def _deciding(rule_ids: Sequence[str]) -> int:
    return sum(CATALOGUE[rule_id].decides for rule_id in rule_ids)


@dataclass(frozen=True)
class Report:
    """Result of one validation.

    Attributes:
        verdict: What the rules together mean.
        tallies: One per rule of the catalogue, in catalogue order.
        funnel: ``None`` where rules that it needs were deselected or no shard could be judged.
        response: What interventions did; ``None`` where the funnel is.
        population: The stored population of a release by partition; ``None`` without one that recomputes.
        errors: Failures of the tool itself.
        cached: What earlier runs judged; ``None`` without a cache.
        causes: Which rules to look at first, and which may fail because of them.
    """

    verdict: Verdict
    dataset: DatasetFacts
    options: RunOptions
    tallies: tuple[Tally, ...]
    funnel: Funnel | None
    response: ResponseSummary | None
    population: dict[str, Any] | None
    waivers: tuple[WaiverOutcome, ...]
    errors: tuple[str, ...]
    validator_version: str
    cached: CacheUse | None = None
    causes: Causes = NO_CAUSES

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Kept findings of all rules, in catalogue order."""
        return tuple(finding for tally in self.tallies for finding in tally.findings)

    @property
    def is_of_drives(self) -> bool:
        """Whether its attempts are drives and their nominals, which are in no branch group."""
        return DECISIONS in self.dataset.rows

    @property
    def lacks_groups(self) -> bool:
        """Whether fewer groups qualify than `--require-groups` demands."""
        required = self.options.require_groups
        return required is not None and (self.num_qualified or 0) < required

    @property
    def noted(self) -> tuple[Tally, ...]:
        """Rules that fail and decide nothing about a verdict: diagnostics and recommendations."""
        return tuple(
            tally
            for tally in self.tallies
            if tally.status == "fail" and not tally.info.decides and tally.info.kind != "qualification"
        )

    @property
    def num_qualified(self) -> int | None:
        """Groups that qualify: of the frozen population of a release and by the funnel; ``None`` if neither is judged.

        A release beside another raw layer than its own may claim more groups than qualify there: the fewer count.
        """
        frozen = None if self.population is None else int(self.population["stages"][-1]["total"])
        by_stage = None if self.funnel is None else self.funnel.qualified
        return min((count for count in (frozen, by_stage) if count is not None), default=None)

    @property
    def num_groups(self) -> int | None:
        """Groups of the raw layer, or, where none is here, those that the release discovered; ``None`` if unknown."""
        if self.dataset.num_shards:
            return self.dataset.num_groups
        return None if self.population is None else int(self.population["stages"][0]["total"])

    @property
    def groups(self) -> tuple[GroupResult, ...] | None:
        """How far each group of the raw layer gets, and why no further; ``None`` where the funnel is not judged."""
        if self.funnel is None:
            return None
        first = {(finding.group_id, finding.rule): finding for finding in reversed(self.findings)}
        return tuple(GroupResult.of(outcome, first) for outcome in self.funnel.outcomes)

    @property
    def conditions(self) -> tuple[str, ...]:
        """What the verdict depends on beside the data, one line each."""
        defaults = Tolerances().model_dump()
        deselected = [tally.rule_id for tally in self.tallies if tally.is_claimed and tally.unjudged == "deselected"]
        waived = [tally for tally in self.tallies if any(f.waived for f in tally.findings)]
        digest = self.dataset.descriptor_digest
        lines = [f"descriptor {digest}" if digest else None]
        lines += [
            f"declared tolerance of {name}: {quote(value)} instead of {quote(defaults[name])}"
            for name, value in self.dataset.tolerances.items()
            if value != defaults[name]
        ]
        lines += self._weaknesses
        if deselected:
            lines.append(f"{counted(len(deselected), 'rule')} deselected, of them {_deciding(deselected)} that decide")
        if not self.options.hashed:
            lines.append("digests of files were not compared")
        if self.options.media != "full":
            lines.append(MEDIA_MODES[self.options.media])
        if waived:
            num_waived = sum(tally.places(f for f in tally.findings if f.waived) for tally in waived)
            lines.append(f"{counted(num_waived, 'violation')} of {counted(len(waived), 'rule')} waived")
        if self.options.require_groups is not None:
            lines.append(f"at least {counted(self.options.require_groups, 'group')} required to qualify")
        if self.cached is not None:
            lines += self.cached.conditions(self.dataset.num_shards)
        if self.options.is_strict:
            lines.append("diagnostics and recommendations required to hold")
        return tuple(line for line in lines if line)

    @property
    def _weaknesses(self) -> list[str]:
        """What the dataset itself leaves out of what rules could judge, one line each."""
        facts, lines = self.dataset, []
        if facts.replay_noise not in (None, "exact"):
            lines.append(f"replay noise declared as {facts.replay_noise}")
            if self.response is not None and (num := self.response.num_repeating):
                alike = "have the poses and speeds of their nominal, to the bit, before the branch"
                lines[-1] += f", though all {counted(num, 'intervention')} {alike}"
        if facts.unrecorded:
            lines.append(f"{counted(len(facts.unrecorded), 'column')} not recorded: {listed(facts.unrecorded)}")
        if facts.unclaimed_streams:
            lines.append(f"streams not claimed: {listed(facts.unclaimed_streams)}")
        if facts.num_missing_attempts:
            lines.append(f"{counted(facts.num_missing_attempts, 'attempt')} missing among the numbers of the others")
        return lines

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: the verdict's, or 1 where too few groups qualify or `--strict` forbids."""
        code = EXIT_OF_VERDICT[self.verdict]
        is_refused = self.lacks_groups or (self.options.is_strict and bool(self.noted))
        return EXIT_INVALID if is_refused and code != EXIT_FAILED else code

    def to_pandas(self) -> Any:
        """The findings as a `pandas.DataFrame`, a row for each that is kept, in catalogue order.

        Columns are those of a finding in the report schema, with its place as one text, and its group.

        Raises:
            PlatformError: pandas is not installed.
        """
        import pyarrow as pa

        rows = [
            {**finding.to_json(), "group_id": finding.group_id, "location": location_text(finding.location)}
            for finding in self.findings
        ]
        return to_pandas(pa.Table.from_pylist(rows, pa.schema([(name, getattr(pa, kind)()) for name, kind in _FRAME])))

    def _repr_html_(self) -> str:
        facts = [
            ("dataset", self.dataset.dataset_id or ""), ("at", self.dataset.path),
            ("groups that qualify", f"{self.num_qualified} of {self.num_groups}"),
            *(("", line) for line in self.conditions),
        ]  # fmt: skip
        columns = [Column.name("rule"), Column.name("place"), Column.name("expected"), Column.name("found")]
        rows = [[f.rule, location_text(f.location), f.expected, f.found] for f in self.findings]
        findings = [Table("Findings", columns, rows)] if rows else []
        return html_of(f"Verdict: {self.verdict}", facts, findings)

    def to_json(self) -> dict[str, Any]:
        """The report as `schemas/v0.1/report.schema.json` has it."""
        return {
            "verdict": self.verdict,
            "exit_code": self.exit_code,
            "spec_version": SPEC_VERSION,
            "validator_version": self.validator_version,
            "dataset": vars(self.dataset),
            "options": {
                "selected": None if self.options.selected is None else list(self.options.selected),
                "ignored": list(self.options.ignored),
                "hashed": self.options.hashed,
                "media": self.options.media,
                "require_groups": self.options.require_groups,
                "strict": self.options.is_strict,
                "links": None if self.options.links is None else list(self.options.links),
            },
            "conditions": list(self.conditions),
            "rules": [
                {
                    "id": tally.rule_id,
                    "title": tally.info.title,
                    "kind": tally.info.kind,
                    "status": tally.status,
                    "reason": tally.reason,
                    "grain": tally.info.grain,
                    "examined": tally.examined,
                    "total": tally.total,
                    "num_findings": tally.num_findings,
                    "num_waived": tally.places(f for f in tally.findings if f.waived),
                    "url": tally.info.url,
                }
                for tally in self.tallies
            ],
            "causes": self.causes.to_json(),
            "findings": [finding.to_json() for finding in self.findings],
            "funnel": None if self.funnel is None else {"basis": FUNNEL_BASIS, **self.funnel.to_json()},
            "groups": None if self.groups is None else [group.to_json() for group in self.groups],
            "response": None if self.response is None else self.response.to_json(),
            "population": self.population,
            "population_basis": None if self.population is None else POPULATION_BASIS,
            "waivers": [outcome.to_json() for outcome in self.waivers],
            "errors": list(self.errors),
            "cached": None if self.cached is None else self.cached.to_json(),
        }
