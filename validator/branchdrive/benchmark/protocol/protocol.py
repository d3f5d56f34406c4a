"""The protocol of a benchmark: what is compared, and how, as data that is locked before anything is compared.

Typed view of `schemas/v0.1/protocol.schema.json`. A family keeps the size that it declares: a member whose models
or selectors have no predictions counts with a p-value of 1, so what is adjusted is an upper bound.

A release brings its own protocol, so one is bounded in what it lets a reader compute, and a model's configuration
may not say another name or contract than the protocol does.

Source: paper, "Benchmark Protocol", "Experiments" and "Discussion, Limitations, and Intended Use";
spec/14-benchmark.md#protocol.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache, cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from branchdrive.benchmark.protocol.family import Family
from branchdrive.benchmark.protocol.selection import ENSEMBLE, LEARNED, Baseline, ProtocolPart, Selection
from branchdrive.contract.document import Integer, dump_json, schema_mismatches
from branchdrive.contract.resources import load_resource
from branchdrive.driving.utility import Profile
from branchdrive.errors import DatasetError

__all__ = [
    "MAX_DRAWS", "MAX_MEMBERS", "MAX_OWNERS", "MAX_REDRAWS", "MAX_SHUFFLED", "BenchmarkProtocol", "DeclaredFamily",
    "DeclaredModel", "Guard", "Kind", "Member", "Partitions", "ProfileWeights", "SelectedOutcomes", "Shuffles",
    "Statistics", "default_protocol", "protocol_digest", "protocol_problem", "read_protocol", "visual_protocol",
]  # fmt: skip

NORMATIVE, VISUAL = "benchmark-protocol.json", "benchmark-protocol-visual.json"
"""The protocol of this version, and that with the models of images, among the schemas."""

PROTOCOL_SCHEMA = "protocol.schema.json"

MAX_MEMBERS = 256
"""Tests of all families together."""

MAX_OWNERS = 256
"""Pairs of a model and a seed, declared or predicted."""

MAX_DRAWS = 2**19
"""Resamples of pairs of a model and a seed, and of models under every profile, declared or predicted."""

MAX_SHUFFLED = 2**14
"""Shuffled predictions: pairs of a model and a seed, kinds of shuffles and their seeds."""

MAX_REDRAWS = 2**17
"""Redraws of guards: pairs of a guarded model and a tolerance, profiles and redraws."""

_SUM_TOLERANCE = 1e-9

Kind = Literal["action", "history", "joint"]
"""Kind of a shuffle: whose action, whose history, or both, a place gets."""


class Partitions(ProtocolPart):
    """What every partition is used for."""

    fit: Literal["train"] = "train"
    select: Literal["val"] = "val"
    calibrate: Literal["calibration"] = "calibration"
    report: Literal["test"] = "test"


class DeclaredModel(ProtocolPart):
    """One model.

    Attributes:
        id: What tables call it.
        title: What it is, a few words.
        contract: Input contract under which it reads.
        seeds: Seeds of its trainings; one for a model that learns no weights.
        configuration: What it and its training are made of, in terms of the software that trains it.
        reported_apart: ``True`` for a model that reads what no vehicle has; tables have it by itself.
    """

    id: str
    title: str
    contract: str
    seeds: Annotated[tuple[Integer, ...], Field(strict=False, min_length=1)]
    configuration: dict[str, Any]
    reported_apart: Literal[True] | None = None

    @property
    def config_digest(self) -> str:
        """SHA-256 of the canonical bytes of the configuration, hexadecimal."""
        return hashlib.sha256(dump_json(self.configuration)).hexdigest()

    def check_configuration(self) -> None:
        """Make sure that name and contract, where the configuration gives them of its `model`, are those of the model.

        Raises:
            ValueError: One is another.
        """
        about = self.configuration.get("model")
        for name, declared in (("name", self.id), ("contract", self.contract)):
            if isinstance(about, dict) and about.get(name, declared) != declared:
                raise ValueError(
                    f"the configuration of the model {self.id!r} has the {name} {about[name]!r:.100}, not {declared!r}"
                )


class Statistics(ProtocolPart):
    """Of intervals and tests."""

    seed: Integer
    resamples: Integer
    level: float
    flips: Integer


class Shuffles(ProtocolPart):
    """Which shuffles are made, with which seeds."""

    kinds: Annotated[tuple[Kind, ...], Field(strict=False)]
    seeds: Annotated[tuple[Integer, ...], Field(strict=False)]


class Member(ProtocolPart):
    """One test: `left` minus `right` in a metric; `profile` for selectors only."""

    left: str
    right: str
    metric: str
    profile: str | None = None

    @property
    def name(self) -> str:
        """What tables call it, such as ``M3-M1.ade_m`` and ``O-M3-action_prior.value.balanced``."""
        end = "" if self.profile is None else f".{self.profile}"
        return f"{self.left}-{self.right}.{self.metric}{end}"


class DeclaredFamily(ProtocolPart):
    """A family of tests, all of one kind."""

    name: str
    kind: Literal["prediction", "ranking"]
    members: Annotated[tuple[Member, ...], Field(strict=False, min_length=1)]

    @property
    def family(self) -> Family:
        """The names of its tests."""
        return Family(self.name, tuple(member.name for member in self.members))


class ProfileWeights(ProtocolPart):
    """Weights of one preference, and the near range in which it scores separation, if it has one."""

    name: str
    separation: float
    displacement: float
    comfort: float
    near_m: float | None = None

    @property
    def profile(self) -> Profile:
        """The same for utilities."""
        return Profile(self.separation, self.displacement, self.comfort, self.near_m)


class SelectedOutcomes(ProtocolPart):
    """That outcomes of selections are reported; a separation of at most `contact_m` is a contact."""

    contact_m: float


class Guard(ProtocolPart):
    """Whose selections are guarded, and at which rates.

    Attributes:
        model: The model whose selections are guarded first.
        alpha: Largest rate of violations.
        delta: Of learn then test.
        tolerance_m: Of a violation, metres: the first one.
        min_groups: Fewest calibration groups.
        min_clusters: Fewest calibration clusters.
        coverage: Of the global margin.
        further_tolerances_m: Tolerances at which everything is judged again.
        further_models: Other models whose selections are guarded, at every tolerance.
        redraws: Further divisions of calibrating and test clusters over which violations are counted.
    """

    model: str
    alpha: float
    delta: float
    tolerance_m: float
    min_groups: Integer
    min_clusters: Integer
    coverage: float
    further_tolerances_m: Annotated[tuple[float, ...], Field(strict=False)] | None = None
    further_models: Annotated[tuple[str, ...], Field(strict=False)] | None = None
    redraws: Integer | None = None

    @property
    def models(self) -> tuple[str, ...]:
        """Guarded models, the first one first."""
        return (self.model, *(self.further_models or ()))

    @property
    def tolerances_m(self) -> tuple[float, ...]:
        """Tolerances, the first one first."""
        return (self.tolerance_m, *(self.further_tolerances_m or ()))

    @property
    def further(self) -> tuple[tuple[str, float], ...]:
        """Pairs of a guarded model and a tolerance, but for the first."""
        return tuple((model, tolerance_m) for model in self.models for tolerance_m in self.tolerances_m)[1:]


class BenchmarkProtocol(ProtocolPart):
    """A protocol; `read_protocol` makes it of a document."""

    name: str
    version: str
    metric_definitions: str
    partitions: Partitions
    targets: Annotated[tuple[str, ...], Field(strict=False)]
    trajectory: Annotated[tuple[str, ...], Field(strict=False)]
    metrics: Annotated[tuple[str, ...], Field(strict=False)]
    models: Annotated[tuple[DeclaredModel, ...], Field(strict=False)]
    statistics: Statistics
    shuffles: Shuffles
    families: Annotated[tuple[DeclaredFamily, ...], Field(strict=False)]
    profiles: Annotated[tuple[ProfileWeights, ...], Field(strict=False)]
    selectors: Annotated[tuple[str, ...], Field(strict=False)]
    guard: Guard
    outcomes: SelectedOutcomes | None = None
    selection: Selection | None = None

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        _check_distinct("models", (model.id for model in self.models))
        _check_distinct("families", (family.name for family in self.families))
        _check_distinct("profiles", (weights.name for weights in self.profiles))
        members = [member for family in self.families for member in family.members]
        if len(members) > MAX_MEMBERS:
            raise ValueError(f"families have {len(members)} members together; the limit is {MAX_MEMBERS}")
        _check_distinct("different members of families", (member.name for member in dict.fromkeys(members)))
        owners = sum(len(model.seeds) for model in self.models)
        if owners > MAX_OWNERS:
            raise ValueError(f"models have {owners} seeds together; the limit is {MAX_OWNERS}")
        if (problem := self.draws_problem(len(self.models), owners)) is not None:
            raise ValueError(problem)
        for model in self.models:
            model.check_configuration()
        for name, profile in self.preferences.items():
            if not math.isclose(sum(profile[:3]), 1.0, abs_tol=_SUM_TOLERANCE):
                raise ValueError(f"weights of the profile {name!r} add up to {sum(profile[:3])!r}, not to 1")
        used = {member.profile for member in members if member.profile is not None}
        if unknown := sorted(used - set(self.preferences)):
            raise ValueError(f"families name the profiles {unknown}; there are {list(self.preferences)}")
        declared = [model.id for model in self.models]
        for guarded in self.guard.models:
            if guarded not in declared:
                raise ValueError(f"the guard's model {guarded!r} is not declared")
        _check_distinct("guarded models", self.guard.models)
        num_redrawn = (1 + len(self.guard.further)) * len(self.profiles) * int(self.guard.redraws or 0)
        if num_redrawn > MAX_REDRAWS:
            raise ValueError(f"guards have {num_redrawn} redraws together; the limit is {MAX_REDRAWS}")
        return self

    @property
    def document(self) -> dict[str, Any]:
        """The protocol as a document."""
        return self.model_dump(mode="json", exclude_none=True)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of its canonical bytes, see `protocol_digest`."""
        return protocol_digest(self.document)

    @property
    def preferences(self) -> dict[str, Profile]:
        """Weights by name of the profile, in the declared order."""
        return {weights.name: weights.profile for weights in self.profiles}

    @property
    def baselines(self) -> tuple[Baseline, ...]:
        """Declared baselines."""
        return () if self.selection is None else self.selection.baselines

    @property
    def predicted(self) -> tuple[str, ...]:
        """Partitions for which locked models predict: all but the one they are fitted on."""
        return (self.partitions.select, self.partitions.calibrate, self.partitions.report)

    @property
    def model_names(self) -> frozenset[str]:
        """Names of models that are declared, or that a declared test is about, as those still to come."""
        sides = {side for family in self.families for member in family.members for side in (member.left, member.right)}
        return frozenset(
            {model.id for model in self.models} | {side.removeprefix(LEARNED).removeprefix(ENSEMBLE) for side in sides}
        )

    def model(self, name: str) -> DeclaredModel | None:
        """The declared model of that name; ``None`` for another."""
        return next((model for model in self.models if model.id == name), None)

    def draws_problem(self, num_models: int, num_owners: int) -> str | None:
        """Which limit resamples and shuffles of so many models, pairs of a model and a seed in all, exceed, if any.

        A baseline counts as a model, and so does every ensemble.
        """
        resamples, shuffles = int(self.statistics.resamples), len(self.shuffles.kinds) * len(self.shuffles.seeds)
        added = self.selection
        ranked = num_models if added is None else num_models * (1 + added.ensembles) + len(added.baselines)
        for what, size, limit in (
            (f"{num_owners} pairs of a model and a seed have", num_owners * resamples, MAX_DRAWS),
            (f"{ranked} models have under all profiles", ranked * len(self.profiles) * resamples, MAX_DRAWS),
        ):
            if size > limit:
                return f"{what} {size} resamples together; the limit is {limit}"
        if num_owners * shuffles > MAX_SHUFFLED:
            return f"{num_owners * shuffles} predictions are shuffled; the limit is {MAX_SHUFFLED}"
        return None

    def of_kind(self, kind: str) -> tuple[DeclaredFamily, ...]:
        """Families of ``prediction`` or ``ranking`` tests."""
        return tuple(family for family in self.families if family.kind == kind)


def _check_distinct(what: str, names: Iterable[str]) -> None:
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise ValueError(f"{what} share a name: {repeated[0]!r}")


def protocol_problem(document: Any) -> str | None:
    """What is wrong with a document beyond its schema, or against it; ``None`` for a protocol."""
    found = _judged(document)
    return found if isinstance(found, str) else None


def read_protocol(document: Any) -> BenchmarkProtocol:
    """The protocol of a document.

    Raises:
        DatasetError: It is no protocol.
    """
    found = _judged(document)
    if isinstance(found, str):
        raise DatasetError(f"not a valid benchmark protocol: {found}")
    return found


def _judged(document: Any) -> BenchmarkProtocol | str:
    """The protocol of a document, or what is wrong with it."""
    for wrong in schema_mismatches(document, PROTOCOL_SCHEMA):
        return f"{wrong.location['pointer']}: expected {wrong.expected}, found {wrong.found}"
    try:
        found = BenchmarkProtocol.model_validate(document)
    except ValidationError as error:
        return str(error.errors(include_url=False, include_context=False)[0]["msg"]).removeprefix("Value error, ")
    for normative in map(load_resource, (NORMATIVE, VISUAL)):
        is_called_so = (found.name, found.version) == (normative["name"], normative["version"])
        if is_called_so and found.digest != protocol_digest(normative):
            return (
                f"it is called {found.name!r} {found.version} and is not the protocol of that name and version; "
                "give it a name of its own"
            )
    return found


@cache
def default_protocol() -> BenchmarkProtocol:
    """The normative protocol of this version, ``schemas/v0.1/benchmark-protocol.json``."""
    return read_protocol(load_resource(NORMATIVE))


@cache
def visual_protocol() -> BenchmarkProtocol:
    """The normative protocol with M4, M5 and M6, ``schemas/v0.1/benchmark-protocol-visual.json``."""
    return read_protocol(load_resource(VISUAL))


def protocol_digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical bytes of a protocol, hexadecimal: those that a writer stores."""
    return hashlib.sha256(dump_json(document)).hexdigest()
