"""What a rule yields, and the registry that binds rule functions to the catalogue.

A rule is a pure function. It says which subjects it examined, which of them violate it, and how
to describe one of them; the engine counts, caps, locates, words and decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.audit.finding import Sighting
from branchdrive.contract.catalogue import CATALOGUE
from branchdrive.errors import BranchDriveError

if TYPE_CHECKING:
    from branchdrive.audit.release.view import ReleaseView
    from branchdrive.audit.selection import Selection
    from branchdrive.audit.survey import Survey
    from branchdrive.audit.view import ShardView

__all__ = [
    "GROUP_RULES", "RELEASE_RULES", "ROLLOUT_RULES", "SHARD_RULES", "SURVEY_RULES", "Mask", "ReleaseCheck", "RowCheck",
    "SubjectCheck", "SurveyCheck", "group_rule", "release_rule", "rollout_rule", "shard_rule", "survey_rule",
]  # fmt: skip

Mask: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True)
class SurveyCheck:
    """Result of a rule on files and documents: subjects looked at, and one sighting per violation."""

    examined: int
    sightings: tuple[Sighting, ...]


@dataclass(frozen=True)
class RowCheck:
    """Result of a rule on rows of one table of a shard.

    Attributes:
        table: Table whose rows were examined, in the view's order.
        column: Column at fault, if it is one.
        examined: Rows looked at.
        bad: Violating rows, ascending.
        describe: Expected and found text of one row.
    """

    table: str
    column: str | None
    examined: int
    bad: NDArray[np.intp]
    describe: Callable[[int], tuple[str, str]]


@dataclass(frozen=True)
class SubjectCheck:
    """Result of a rule on rollouts or groups of a shard.

    Attributes:
        examined: Subjects looked at.
        bad: Violating subjects, a subset of `examined`.
        describe: Sighting of one violating subject; the engine adds its identity.
    """

    examined: Mask
    bad: Mask
    describe: Callable[[int], Sighting]


@dataclass(frozen=True)
class ReleaseCheck:
    """Result of a rule on the derived layers, or of a part of it.

    Attributes:
        examined: Subjects looked at.
        num_bad: Violating subjects, exact.
        sightings: Violations in order, made while they are read: only the first of them are.
    """

    examined: int
    num_bad: int = 0
    sightings: Iterable[Sighting] = ()

    @classmethod
    def of(cls, examined: int, sightings: Iterable[Sighting]) -> ReleaseCheck:
        """Check with one sighting for every violating subject."""
        seen = tuple(sightings)
        return cls(max(examined, len(seen)), len(seen), seen)


SurveyRule: TypeAlias = "Callable[[Survey], SurveyCheck]"
ShardRule: TypeAlias = "Callable[[ShardView], Iterable[RowCheck]]"
RolloutRule: TypeAlias = "Callable[[ShardView, Mask], SubjectCheck]"
ReleaseRule: TypeAlias = "Callable[[ReleaseView], Iterable[ReleaseCheck]]"
GroupRule: TypeAlias = "Callable[[ShardView, Selection, Mask], SubjectCheck]"

SURVEY_RULES: dict[str, SurveyRule] = {}
"""Rules on the dataset as files and documents."""
SHARD_RULES: dict[str, ShardRule] = {}
"""Structure rules on the rows of a shard."""
ROLLOUT_RULES: dict[str, RolloutRule] = {}
"""Qualification rules on attempts; the mask says which to examine."""
GROUP_RULES: dict[str, GroupRule] = {}
"""Qualification rules on branch groups, after the candidates are selected."""
RELEASE_RULES: dict[str, ReleaseRule] = {}
"""Rules on the derived layers, after the raw layer."""


def _register(registry: dict[str, Callable[..., object]], rule_id: str, function: Callable[..., object]) -> None:
    if rule_id not in CATALOGUE:
        raise BranchDriveError(f"rule {rule_id!r} is not in schemas/v0.1/rules.json")
    if any(rule_id in known for known in (SURVEY_RULES, SHARD_RULES, ROLLOUT_RULES, GROUP_RULES, RELEASE_RULES)):
        raise BranchDriveError(f"rule {rule_id!r} is bound twice")
    registry[rule_id] = function


def survey_rule(rule_id: str) -> Callable[[SurveyRule], SurveyRule]:
    """Bind a function of a `Survey` to a rule id."""

    def bind(function: SurveyRule) -> SurveyRule:
        _register(SURVEY_RULES, rule_id, function)  # type: ignore[arg-type]
        return function

    return bind


def shard_rule(rule_id: str) -> Callable[[ShardRule], ShardRule]:
    """Bind a function of a `ShardView` that yields row checks to a rule id."""

    def bind(function: ShardRule) -> ShardRule:
        _register(SHARD_RULES, rule_id, function)  # type: ignore[arg-type]
        return function

    return bind


def rollout_rule(rule_id: str) -> Callable[[RolloutRule], RolloutRule]:
    """Bind a function of a `ShardView` and a mask of its rollouts to a rule id."""

    def bind(function: RolloutRule) -> RolloutRule:
        _register(ROLLOUT_RULES, rule_id, function)  # type: ignore[arg-type]
        return function

    return bind


def group_rule(rule_id: str) -> Callable[[GroupRule], GroupRule]:
    """Bind a function of a `ShardView`, its selection and a mask of its groups to a rule id."""

    def bind(function: GroupRule) -> GroupRule:
        _register(GROUP_RULES, rule_id, function)  # type: ignore[arg-type]
        return function

    return bind


def release_rule(rule_id: str) -> Callable[[ReleaseRule], ReleaseRule]:
    """Bind a function of a `ReleaseView` that yields checks to a rule id."""

    def bind(function: ReleaseRule) -> ReleaseRule:
        _register(RELEASE_RULES, rule_id, function)  # type: ignore[arg-type]
        return function

    return bind
