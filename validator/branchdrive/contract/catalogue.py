"""The rule catalogue: every rule's id, kind, clause and remedy, from `schemas/v0.1/rules.json`.

Code binds to rules by id only; ids are opaque and never change meaning. Source: spec/07-rules.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from branchdrive.contract.resources import load_resource

__all__ = ["AREAS", "CATALOGUE", "Grain", "Kind", "RuleInfo", "Stage"]

Kind = Literal["structure", "claim", "qualification", "diagnostic"]
Grain = Literal["dataset", "file", "document", "row", "rollout", "group"]
Stage = Literal["bank", "controls", "integrity", "eligibility"]


@dataclass(frozen=True)
class RuleInfo:
    """What the catalogue says about one rule.

    Attributes:
        id: Stable identity, ``BD-`` area ``-`` number.
        kind: What a failure means (spec/07-rules.md#kinds).
        grain: The subject that the rule counts.
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


def _rule(declared: Mapping[str, Any]) -> RuleInfo:
    lists = {key: tuple(declared.get(key, ())) for key in ("streams", "requires", "reads", "consequences")}
    return RuleInfo(**{**declared, **lists})


CATALOGUE: Mapping[str, RuleInfo] = MappingProxyType(
    {declared["id"]: _rule(declared) for declared in load_resource("rules.json")["rules"]}
)
"""Every rule by id, in catalogue order."""

AREAS: Mapping[str, str] = MappingProxyType(load_resource("rules.json")["areas"])
"""What the three letters of a rule id stand for."""
