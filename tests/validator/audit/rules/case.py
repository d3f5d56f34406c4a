"""Registered cases of the rules: defects that one rule must find, and limits that it must still accept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from tests import synthetic
from tests.validator.audit.rules.draft import Draft

from branchdrive.contract.catalogue import CATALOGUE

Edit: TypeAlias = Callable[[Draft], object]
Base = Literal["full", "media", "bare"]

SHARD_0, SHARD_1 = synthetic.SHARDS

NOMINAL = "g0.nominal.a1"
REPLAY = "g0.nominal_replay.a1"
BRAKE = "g0.brake_0.50.a1"
ACCELERATE = "g0.accelerate_0.50.a1"
STEER_LEFT = "g0.steer_left_0.10.a1"
"""Attempts of the first group that cases edit."""


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
    def may_fail(self) -> frozenset[str]:
        """The rule and its declared consequences."""
        return frozenset({self.rule, *CATALOGUE[self.rule].consequences})


@dataclass(frozen=True)
class Boundary:
    """A shape at the limit of what rules accept: the dataset stays valid and none of its groups is lost.

    Attributes:
        rules: The rules whose limit it is.
        name: Name of the shape, unique.
        edit: Puts the shape into a valid draft.
        base: Which valid dataset to change.
        status: Status of the rules on it.
    """

    rules: tuple[str, ...]
    name: str
    edit: Edit
    base: Base
    status: str


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
    base: Base = "full",
    findings: int = 1,
    lost: int | None = None,
    name: str | None = None,
) -> Callable[[Edit], Edit]:
    """Register a function as a defect of `rule`; one of qualification costs one group unless `lost` differs."""

    def register(edit: Edit) -> Edit:
        cost = int(CATALOGUE[rule].kind == "qualification") if lost is None else lost
        label = name or edit.__name__.strip("_")
        assert all((label, rule) != (known.name, known.rule) for known in REGISTRY.mutants), f"{rule} {label} twice"
        REGISTRY.mutants.append(Mutant(rule, label, edit, base, at or {}, findings, cost))
        return edit

    return register


def boundary(*rules: str, base: Base = "full", status: str = "pass", name: str | None = None) -> Callable[[Edit], Edit]:
    """Register a function as a shape that `rules` must accept."""

    def register(edit: Edit) -> Edit:
        assert set(rules) <= set(CATALOGUE), rules
        label = name or edit.__name__.strip("_")
        assert all(label != known.name for known in REGISTRY.boundaries), f"{label} twice"
        REGISTRY.boundaries.append(Boundary(rules, label, edit, base, status))
        return edit

    return register


def new_draft(base: Base = "full") -> Draft:
    """A valid dataset to edit: with actors and evidence, with media too, or without either."""
    match base:
        case "full":
            return Draft(synthetic.base_tables(), synthetic.descriptor())
        case "media":
            return Draft(synthetic.media_tables(), synthetic.media_descriptor())
        case "bare":
            return Draft(synthetic.bare_tables(), synthetic.bare_descriptor())
