"""Rules: what the catalogue `schemas/v0.1/rules.json` declares of each, and the registry of their functions.

A rule is a function of a view of its scope. It yields checks: what it examined, which subjects mismatch, and how
to describe one of them; the engine counts, caps, locates and decides. Code binds to rules by id only; ids are
opaque and never change meaning.

==============  ==========================================================================================
scope           arguments of the rule
==============  ==========================================================================================
``dataset``     the survey of the dataset's files and documents, with what the shards say of themselves
``rows``        the view of a shard
``rollout``     the view of a shard, and a mask of the attempts to examine
``group``       the view of a shard, the selection of its candidates, and a mask of the groups to examine
``layers``      the view of the derived layers
``layer_rows``  that view, restricted to the rows of the attempts and groups of one shard
==============  ==========================================================================================

Source: spec/07-rules.md.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, TypeVar

from branchdrive.contract.columns import DECISIONS
from branchdrive.contract.mismatch import Check
from branchdrive.contract.resources import load_resource, project_url
from branchdrive.errors import BranchDriveError

__all__ = [
    "AREAS", "CATALOGUE", "PIECES", "RULES", "Grain", "Kind", "Rule", "RuleInfo", "Scope", "Stage", "cause_order",
    "rule", "rules_of",
]  # fmt: skip

Kind = Literal["structure", "claim", "qualification", "diagnostic"]
Grain = Literal["dataset", "file", "document", "row", "rollout", "group"]
Scope = Literal["dataset", "rows", "rollout", "group", "layers", "layer_rows"]
Stage = Literal["bank", "controls", "integrity", "eligibility"]


@dataclass(frozen=True)
class RuleInfo:
    """What the catalogue says about one rule.

    Attributes:
        id: Stable identity, ``BD-`` area ``-`` number.
        kind: What a failure means (spec/07-rules.md#kinds).
        grain: The subject that the rule counts.
        scope: What the rule is a function of, see above.
        clause: Chapter and anchor that the rule enforces.
        stage: Funnel stage that a qualification failure costs a group.
        streams: The rule is not claimed unless the descriptor claims one of these.
        layer: The rule is not claimed unless the descriptor claims this derived layer.
        needs_raw: Whether judging the rule takes the raw layer, in place or named beside the release.
        requires: Rules whose failure excludes a subject from this one.
        reads: Tables or columns that the rule reads, where that is narrower than its area.
        consequences: Rules that a single defect of this rule breaks with it.
    """

    id: str
    title: str
    kind: Kind
    level: Literal["MUST", "SHOULD"]
    grain: Grain
    scope: Scope
    clause: str
    remedy: str
    stage: Stage | None = None
    streams: tuple[str, ...] = ()
    layer: str | None = None
    needs_raw: bool = False
    requires: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    consequences: tuple[str, ...] = ()

    @property
    def decides(self) -> bool:
        """Whether the rule can make a dataset invalid."""
        return self.kind in ("structure", "claim") and self.level == "MUST"

    @property
    def broken(self) -> str:
        """The title of a failure: what does not hold, since titles say what should."""
        return f"Does not hold: {self.title}"

    def is_about(self, streams: Collection[str]) -> bool:
        """Whether the rule is about what a dataset with these streams holds; one of drives holds no branch groups."""
        if self.scope == "group" and DECISIONS in streams:
            return False
        return not self.streams or not set(self.streams).isdisjoint(streams)

    @property
    def url(self) -> str | None:
        """Where the page of the rule is on the web; ``None`` where the distribution names no place."""
        return f"{base}/docs/rules/{self.id}.md" if (base := project_url()) else None

    @property
    def explained(self) -> str:
        """Where the rule is explained: its page, or the command that prints it."""
        return self.url or f"`branchdrive rules {self.id}` explains it"


def _rule(declared: Mapping[str, Any]) -> RuleInfo:
    lists = {key: tuple(declared.get(key, ())) for key in ("streams", "requires", "reads", "consequences")}
    return RuleInfo(**{**declared, **lists})


CATALOGUE: Mapping[str, RuleInfo] = MappingProxyType(
    {declared["id"]: _rule(declared) for declared in load_resource("rules.json")["rules"]}
)
"""Every rule by id, in catalogue order."""

Rule: TypeAlias = Callable[..., Iterable[Check]]
AnyRule = TypeVar("AnyRule", bound=Rule)

RULES: dict[str, Rule] = {}
"""Functions of the rules by id, as far as their modules are imported."""


PIECES: dict[str, tuple[Callable[[Any], Any], ...]] = {}
"""What rules of the scope ``layers`` take of each part of the derived layers, by id, as far as modules are imported."""


def rule(rule_id: str, *pieces: Callable[[Any], Any]) -> Callable[[AnyRule], AnyRule]:
    """Bind a function to a rule of the catalogue.

    Args:
        rule_id: The rule.
        pieces: Functions of a view of a part whose results the rule merges; see `ReleaseView.merged`.

    Raises:
        BranchDriveError: The catalogue has no such rule, or it is bound already.
    """

    def bind(function: AnyRule) -> AnyRule:
        if rule_id not in CATALOGUE:
            raise BranchDriveError(f"rule {rule_id!r} is not in schemas/v0.1/rules.json")
        if rule_id in RULES:
            raise BranchDriveError(f"rule {rule_id!r} is bound twice")
        RULES[rule_id], PIECES[rule_id] = function, pieces
        return function

    return bind


def rules_of(*scopes: Scope) -> tuple[str, ...]:
    """Rules of some scopes, in order of the catalogue."""
    return tuple(rule_id for rule_id, info in CATALOGUE.items() if info.scope in scopes)


AREAS: Mapping[str, str] = MappingProxyType(load_resource("rules.json")["areas"])
"""What the three letters of a rule id stand for."""

_RECOMPUTED = "EVD"
"""The area of evidence, which is computed from boxes and motion, and stands behind all others."""

_CAUSES = (
    "LAY", "DOC", "ENC", "TAB", "VAL", "NUL", "KEY", "STA", "TIC", "RSP", "MOT", "BOX", "ACT", "MAP", "RTE", "CTL",
    "TRG", "RPN", "GRP",
)  # fmt: skip
"""Areas whose defects explain others, the first causes first: a wrong unit of speed fails what is computed from it."""

_MOTION = "MOT"

_NAME_CAUSES = ("BD-GRP-009", "BD-GRP-010", "BD-MOT-006")
"""Rules whose findings name why motion is wrong, and stand before it: another action, a unit, a sign."""

_PLACE = {rule_id: place for place, rule_id in enumerate(CATALOGUE)}


def cause_order(rule_id: str) -> tuple[int, int, int]:
    """Sort key of rules that fail together: causes before their consequences, else as in the catalogue."""
    names_cause = rule_id in _NAME_CAUSES
    area = _MOTION if names_cause else rule_id[3:6]
    place = _CAUSES.index(area) if area in _CAUSES else len(_CAUSES) + (area == _RECOMPUTED)
    within = _NAME_CAUSES.index(rule_id) if names_cause else len(_NAME_CAUSES)
    return (place, within, _PLACE[rule_id])
