"""The descriptor `branchdrive.json`: what a dataset is and which streams it claims to hold.

Typed view of `schemas/v0.1/descriptor.schema.json`; a differential test holds both together.
Source: spec/03-layout.md.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.camera import Camera
from branchdrive.contract.columns import DECISIONS, RECORDABLE, STREAMS, TABLES
from branchdrive.contract.document import Integer
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import MAX_SHARD_INDEX
from branchdrive.contract.refusal import Document
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.text import listed

__all__ = [
    "Collection", "DeclaredEncoding", "Descriptor", "Driver", "Origin", "Rates", "ReplayNoise", "Software",
    "Tolerances", "Vehicle",
]  # fmt: skip

_Identifier = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,127}$")]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._:/+-]{0,127}$")]
_Label = Annotated[str, Field(pattern=r"^[!-~]([ -~]{0,126}[!-~])?$")]
_Shares = Annotated[dict[_Identifier, Annotated[float, Field(ge=0, le=1)]], Field(max_length=64)]
_ShardNumber = Annotated[Integer, Field(ge=0, le=MAX_SHARD_INDEX)]
_Prose = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]{1,2000}$")]


_OF_EXPERT = tuple(f"observations.{c.name}" for c in TABLES["observations"].columns if c.track == "mixed")
"""Columns that only a driver who plans can compute."""


class Software(Document):
    """Name and version of a program."""

    name: _Name
    version: _Name


class Rates(Document):
    """Rates of the recorded streams; this spec version has one clock."""

    tick_s: Annotated[float, Field(ge=0.05, le=0.05)] = 0.05
    observation_stride_ticks: Annotated[Integer, Field(ge=5, le=5)] = 5


class DeclaredEncoding(Document):
    """Action encoding of the bank, with the digest of its float32 matrix (row-major, little-endian)."""

    name: _Identifier
    width: Annotated[Integer, Field(ge=1, le=4096)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]

    @model_validator(mode="after")
    def _known_width(self) -> Self:
        if self.name == ENCODING_NAME and self.width != ENCODING_WIDTH:
            raise ValueError(f"the encoding `{ENCODING_NAME}` has width {ENCODING_WIDTH}; found {self.width}")
        return self


class Tolerances(Document):
    """Declared tolerances; 0 asks for exact equality in float32."""

    actuator: Annotated[float, Field(ge=0, le=0.02)] = 0.0
    evidence: Annotated[float, Field(ge=0, le=0.001)] = 1e-6


class Vehicle(Document):
    """What the commands of the ego vehicle mean; ``None`` where it is not known.

    Attributes:
        wheelbase_m: Distance of the axles.
        max_steer_rad: Angle of the front wheels at a steering command of 1.
        max_accel_mps2: Largest acceleration, at a throttle command of 1.
        max_decel_mps2: Largest deceleration, at a brake command of 1.
        actuation: ``pedals`` for throttle and brake of their own, ``single_axis`` where both are one axis.
    """

    wheelbase_m: Annotated[float, Field(gt=0, le=50)] | None = None
    max_steer_rad: Annotated[float, Field(gt=0, le=1.5708)] | None = None
    max_accel_mps2: Annotated[float, Field(gt=0, le=100)] | None = None
    max_decel_mps2: Annotated[float, Field(gt=0, le=100)] | None = None
    actuation: Literal["pedals", "single_axis"] | None = None


class Driver(Document):
    """Who drove where no policy of the bank did: a privileged expert, a recorded log, or a learned policy."""

    kind: Literal["expert", "log", "learned"]


class ReplayNoise(Document):
    """What tells a replay from the drive that it repeats.

    Attributes:
        kind: ``exact``: nothing; ``injected``: noise of the collector; ``natural``: whatever the simulator has.
        strength: Strength of injected noise, in the collector's own unit; of no other kind.
    """

    kind: Literal["exact", "injected", "natural"]
    strength: Annotated[float, Field(gt=0, le=100)] | None = None

    @classmethod
    def of_strength(cls, strength: float) -> ReplayNoise:
        """Injected noise of a strength; 0 is exact."""
        return cls(kind="injected", strength=strength) if strength else cls(kind="exact")

    @model_validator(mode="after")
    def _strength_is_of_injected_noise(self) -> Self:
        if (self.strength is not None) != (self.kind == "injected"):
            raise ValueError(f"injected noise, and no other, has a strength; found {self.kind} and {self.strength}")
        return self


def _from_number(value: Any) -> Any:
    """A number alone is short for the strength of injected noise."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number:
        return value
    return {"kind": "injected", "strength": value} if value else {"kind": "exact"}


class Origin(Document):
    """Shards that had other numbers in the dataset that they were collected into.

    Attributes:
        identity: Identity of the files of that dataset.
        first_shard: Number of the first of them in this dataset; the others follow it.
        shards: Numbers that they had.
    """

    identity: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    first_shard: _ShardNumber
    shards: Annotated[tuple[_ShardNumber, ...], Field(strict=False, min_length=1, max_length=200_000, fail_fast=True)]


class Collection(Document):
    """What the collector switched on.

    Attributes:
        seed: Seed of the collection.
        replay_noise: What tells a replay from the drive that it repeats.
        faults: Rates of injected faults by name.
        branches: Shares of planned groups by the kind of branch that was asked of their trigger; empty, and left out
            of documents, where all branch at the manoeuvre.
        scenario_types: Scenario types that the plan was restricted to; empty if it was not.
        origins: Where shards with other numbers come from; empty, and left out of documents, where none has another.
    """

    seed: Annotated[Integer, Field(ge=0, le=9223372036854775807)]
    replay_noise: Annotated[ReplayNoise, BeforeValidator(_from_number)] = ReplayNoise(kind="exact")
    faults: _Shares = Field(default_factory=dict)
    branches: _Shares = Field(default_factory=dict)
    scenario_types: Annotated[tuple[_Label, ...], Field(strict=False, max_length=256, fail_fast=True)] = ()
    origins: Annotated[tuple[Origin, ...], Field(strict=False, max_length=4096, fail_fast=True)] = ()

    @model_validator(mode="after")
    def _scenario_types_differ(self) -> Self:
        if len(set(self.scenario_types)) != len(self.scenario_types):
            raise ValueError("scenario_types must not repeat")
        return self

    @model_serializer(mode="wrap")
    def _document(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        document: dict[str, Any] = serialize(self)
        for name in ("branches", "origins"):
            if not document[name]:
                del document[name]
        return document


class Descriptor(Document):
    """A dataset's descriptor.

    Attributes:
        streams: Claimed streams; every shard holds the tables of a claimed stream and no others.
        layers: Claimed layers in the order of derivation; a detached release has no ``raw``.
        unrecorded: Columns that the world does not offer, as ``table.column``; they are null throughout.
        action_encoding: ``None`` if the bank declares no encoding.
        vehicle: What is known of the ego vehicle; ``None`` where nothing is declared.
        driver: Who drove; ``None`` where it is not declared.
        description: What the dataset is, in a few sentences; ``None`` where it says nothing, as in the next ones.
        creators: Names of the people and institutions that made it.
        citation: How to cite it, as one text.
        doi: Its digital object identifier, without a resolver before it.
        url: Where it is published.
        keywords: What to find it by.
    """

    spec_version: Literal["0.1"] = SPEC_VERSION  # type: ignore[assignment]
    dataset_id: _Identifier
    dataset_version: Annotated[str, Field(pattern=r"^(0|[1-9][0-9]{0,5})\.(0|[1-9][0-9]{0,5})\.(0|[1-9][0-9]{0,5})$")]
    title: Annotated[str, Field(min_length=1, max_length=200)]
    licence: _Name
    simulator: Software
    collector: Software
    rates: Rates = Rates()
    streams: Annotated[tuple[str, ...], Field(strict=False, max_length=len(STREAMS))]
    cameras: Annotated[tuple[Camera, ...], Field(strict=False, max_length=64, fail_fast=True)] = ()
    unrecorded: Annotated[tuple[str, ...], Field(strict=False, max_length=len(RECORDABLE))] = ()
    layers: Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=5)] = ("raw",)
    action_bank: ActionBank
    action_encoding: DeclaredEncoding | None = None
    tolerances: Tolerances = Tolerances()
    collection: Collection
    vehicle: Vehicle | None = None
    driver: Driver | None = None
    description: _Prose | None = None
    creators: Annotated[tuple[_Prose, ...], Field(strict=False, max_length=64, fail_fast=True)] = ()
    citation: _Prose | None = None
    doi: Annotated[str, Field(pattern=r"^10\.[0-9]{4,9}/[!-~]{1,200}$")] | None = None
    url: Annotated[str, Field(pattern=r"^https?://[!-~]{1,500}$")] | None = None
    keywords: Annotated[tuple[_Name, ...], Field(strict=False, max_length=64, fail_fast=True)] = ()

    @model_validator(mode="after")
    def _claims_agree(self) -> Self:
        unknown = sorted(set(self.streams) - set(STREAMS))
        if unknown:
            raise ValueError(f"unknown streams {unknown}; this version knows {list(STREAMS)}")
        if len(set(self.streams)) != len(self.streams):
            raise ValueError("streams must not repeat")
        missing = [name for name, stream in STREAMS.items() if stream.required and name not in self.streams]
        if missing:
            raise ValueError(f"streams {missing} are required")
        names = [camera.name for camera in self.cameras]
        if len(set(names)) != len(names):
            raise ValueError("camera names must not repeat")
        unclaimed = sorted({camera.stream for camera in self.cameras} - set(self.streams))
        if unclaimed:
            raise ValueError(f"cameras belong to the streams {unclaimed}, which are not claimed")
        declared = {(camera.name, camera.stream) for camera in self.cameras}
        lacking = [c for name in self.streams for c in STREAMS[name].cameras if (c, name) not in declared]
        if lacking:
            raise ValueError(f"the cameras {listed(lacking)}, which claimed media streams need, each with its stream")
        return self

    @model_validator(mode="after")
    def _layers_follow_each_other(self) -> Self:
        chain = ("raw", *LAYERS)
        if not any(self.layers == chain[start:stop] for start in (0, 1) for stop in range(start + 1, len(chain) + 1)):
            raise ValueError(
                f"layers are the first ones of {list(chain)}, with or without raw; found {list(self.layers)}"
            )
        if self.is_of_drives and self.layers != ("raw",):
            raise ValueError(f"no layer is derived from drives, the stream {DECISIONS!r}; found {list(self.layers)}")
        return self

    @model_validator(mode="after")
    def _absences_agree(self) -> Self:
        unknown = sorted(set(self.unrecorded) - set(RECORDABLE))
        if unknown:
            raise ValueError(f"columns {unknown} cannot be unrecorded; those that can are {list(RECORDABLE)}")
        if len(set(self.unrecorded)) != len(self.unrecorded):
            raise ValueError("unrecorded columns must not repeat")
        invented = [column for column in _OF_EXPERT if column not in self.unrecorded]
        if self.driver is not None and self.driver.kind == "log" and invented:
            raise ValueError(f"a log has no expert that computes {invented}; list them as unrecorded")
        return self

    @property
    def has_raw(self) -> bool:
        """Whether the dataset holds its raw layer; a detached release names it by digest."""
        return "raw" in self.layers

    @property
    def is_of_drives(self) -> bool:
        """Whether attempts are drives and their nominals, which are in no branch group."""
        return DECISIONS in self.streams

    @property
    def derived_layers(self) -> tuple[str, ...]:
        """Claimed layers that are derived from the raw one, in order."""
        return tuple(layer for layer in self.layers if layer != "raw")

    @property
    def tables(self) -> tuple[str, ...]:
        """Tables that every shard holds, in declared order: those of the claimed streams, rollouts first."""
        claimed = {table for name in self.streams for table in STREAMS[name].tables}
        return tuple(name for name in TABLES if name in claimed)

    @property
    def without_media(self) -> Descriptor:
        """The same before any media were made: without cameras, and the streams that need some."""
        streams = tuple(name for name in self.streams if not STREAMS[name].cameras)
        return self.model_copy(update={"cameras": (), "streams": streams})

    @property
    def cameras_by_name(self) -> dict[str, Camera]:
        """Cameras by their names."""
        return {camera.name: camera for camera in self.cameras}
