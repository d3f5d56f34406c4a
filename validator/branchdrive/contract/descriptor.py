"""The descriptor `branchdrive.json`: what a dataset is and which streams it claims to hold.

Typed view of `schemas/v0.1/descriptor.schema.json`; a differential test holds both together.
Source: spec/03-layout.md.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import STREAMS, TABLES
from branchdrive.contract.document import Integer
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.resources import SPEC_VERSION

__all__ = ["Camera", "Collection", "DeclaredEncoding", "Descriptor", "Rates", "Software", "Tolerances"]

_Identifier = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]{0,127}$")]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._:/+-]{0,127}$")]


class _Document(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Software(_Document):
    """Name and version of a program."""

    name: _Name
    version: _Name


class Rates(_Document):
    """Rates of the recorded streams; this spec version has one clock."""

    tick_s: Annotated[float, Field(ge=0.05, le=0.05)] = 0.05
    observation_stride_ticks: Annotated[Integer, Field(ge=5, le=5)] = 5


class Camera(_Document):
    """One camera of the media index, pose in the ego frame."""

    name: _Identifier
    width_px: Annotated[Integer, Field(ge=1, le=16384)]
    height_px: Annotated[Integer, Field(ge=1, le=16384)]
    fov_rad: Annotated[float, Field(gt=0, le=6.2832)]
    x_m: Annotated[float, Field(ge=-100, le=100)]
    y_m: Annotated[float, Field(ge=-100, le=100)]
    z_m: Annotated[float, Field(ge=-100, le=100)]
    yaw_rad: Annotated[float, Field(ge=-3.1416, le=3.1416)]
    pitch_rad: Annotated[float, Field(ge=-3.1416, le=3.1416)]


class DeclaredEncoding(_Document):
    """Action encoding of the bank, with the digest of its float32 matrix (row-major, little-endian)."""

    name: _Identifier
    width: Annotated[Integer, Field(ge=1, le=4096)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]

    @model_validator(mode="after")
    def _known_width(self) -> Self:
        if self.name == ENCODING_NAME and self.width != ENCODING_WIDTH:
            raise ValueError(f"the encoding `{ENCODING_NAME}` has width {ENCODING_WIDTH}; found {self.width}")
        return self


class Tolerances(_Document):
    """Declared tolerances; 0 asks for exact equality in float32."""

    actuator: Annotated[float, Field(ge=0, le=0.02)] = 0.0
    evidence: Annotated[float, Field(ge=0, le=0.001)] = 1e-6


class Collection(_Document):
    """What the collector switched on.

    Attributes:
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays; 0 is off.
        faults: Rates of injected faults by name.
        scenario_types: Scenario types that the plan was restricted to; empty if it was not.
    """

    seed: Annotated[Integer, Field(ge=0, le=9223372036854775807)]
    replay_noise: Annotated[float, Field(ge=0, le=100)] = 0.0
    faults: Annotated[dict[_Identifier, Annotated[float, Field(ge=0, le=1)]], Field(max_length=64)] = Field(
        default_factory=dict
    )
    scenario_types: Annotated[tuple[_Name, ...], Field(strict=False, max_length=256, fail_fast=True)] = ()

    @model_validator(mode="after")
    def _scenario_types_differ(self) -> Self:
        if len(set(self.scenario_types)) != len(self.scenario_types):
            raise ValueError("scenario_types must not repeat")
        return self


class Descriptor(_Document):
    """A dataset's descriptor.

    Attributes:
        streams: Claimed streams; every shard holds the tables of a claimed stream and no others.
        layers: Claimed layers in the order of derivation; a detached release has no ``raw``.
        action_encoding: ``None`` if the bank declares no encoding.
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
    layers: Annotated[tuple[str, ...], Field(strict=False, min_length=1, max_length=5)] = ("raw",)
    action_bank: ActionBank
    action_encoding: DeclaredEncoding | None = None
    tolerances: Tolerances = Tolerances()
    collection: Collection

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
        lacking = [c for name in self.streams for c in STREAMS[name].cameras if c not in names]
        if lacking:
            raise ValueError(f"claimed media streams need the cameras {lacking}")
        return self

    @model_validator(mode="after")
    def _layers_follow_each_other(self) -> Self:
        chain = ("raw", *LAYERS)
        if not any(self.layers == chain[start:stop] for start in (0, 1) for stop in range(start + 1, len(chain) + 1)):
            raise ValueError(
                f"layers are the first ones of {list(chain)}, with or without raw; found {list(self.layers)}"
            )
        return self

    @property
    def has_raw(self) -> bool:
        """Whether the dataset holds its raw layer; a detached release names it by digest."""
        return "raw" in self.layers

    @property
    def derived_layers(self) -> tuple[str, ...]:
        """Claimed layers that are derived from the raw one, in order."""
        return tuple(layer for layer in self.layers if layer != "raw")

    @property
    def tables(self) -> tuple[str, ...]:
        """Tables that every shard holds, in declared order: those of the claimed streams, rollouts first."""
        claimed = {table for name in self.streams for table in STREAMS[name].tables}
        return tuple(name for name in TABLES if name in claimed)
