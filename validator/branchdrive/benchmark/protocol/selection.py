"""Declared selection beyond the paper's: baselines with what they see, references that selectors are held against.

Typed view of `selection` in `schemas/v0.1/protocol.schema.json`. A protocol without it ranks what the paper ranks.

Source: this project's choice; spec/14-benchmark.md#baselines.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from branchdrive.contract.document import Integer

__all__ = [
    "ENSEMBLE", "FIXED", "LEARNED", "MEAN", "Baseline", "Neighbours", "Prior", "ProtocolPart", "Ridge", "Selection",
]  # fmt: skip

FIXED = ("random", "nominal", "action_prior", "fixed_brake")
"""Selectors that see nothing of a group."""

LEARNED = "O-"
"""Name of an outcome-derived selector, before that of its model."""

ENSEMBLE = "E-"
"""Name of the selector by the mean prediction of the seeds of a model, before that of the model."""

MEAN = "M0"
"""The model of the protocols that learns no weights and looks at nothing: the mean over all training rows."""

_RESERVED = (*FIXED, "oracle")


class ProtocolPart(BaseModel):
    """A part of a protocol: frozen, and exactly what is declared."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Prior(ProtocolPart):
    """Mean training utility of each candidate in the cell of a group, shrunk to that of all training groups.

    Attributes:
        name: Name of the selector.
        by: What makes a cell; a group of a cell that training does not hold has the mean of all.
        strength: As how many groups the mean of all training groups counts.
    """

    name: str
    kind: Literal["prior"]
    by: Annotated[tuple[Literal["scenario_type", "town", "command", "speed_limit"], ...], Field(strict=False)]
    strength: float

    @property
    def sees(self) -> str:
        """What it sees of a group."""
        return ", ".join(label.replace("_", " ") for label in self.by)


class _ReadsHistory(ProtocolPart):
    """A baseline that reads histories.

    Attributes:
        name: Name of the selector.
        contract: Input contract under which it reads them.
    """

    name: str
    contract: str

    @property
    def sees(self) -> str:
        """What it sees of a group."""
        return f"{self.contract} history"


class Neighbours(_ReadsHistory):
    """Mean utility of each candidate in the training groups of the nearest histories.

    Attributes:
        neighbours: How many training groups; those that tie with the last of them count too.
    """

    kind: Literal["neighbours"]
    neighbours: Integer


class Ridge(_ReadsHistory):
    """Utility of each candidate regressed on the history, with a penalty on the squares of weights.

    Attributes:
        strength: Of the penalty, by training group.
    """

    kind: Literal["ridge"]
    strength: float


Baseline = Annotated[Prior | Neighbours | Ridge, Field(discriminator="kind")]


class Selection(ProtocolPart):
    """What is ranked beside the selectors of the paper.

    Attributes:
        ensembles: Whether the mean prediction of the seeds of a model selects too.
        references: Selectors that every learned one is held against.
        baselines: Declared baselines.
    """

    ensembles: bool
    references: Annotated[tuple[str, ...], Field(strict=False)]
    baselines: Annotated[tuple[Baseline, ...], Field(strict=False)]

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        names = [baseline.name for baseline in self.baselines]
        for name in names:
            if name in _RESERVED or names.count(name) > 1:
                raise ValueError(f"baselines need names of their own; {name!r} is taken")
        for name in self.references:
            if name not in (*FIXED, *names):
                raise ValueError(f"the reference {name!r} is no baseline; there are {[*FIXED, *names]}")
        return self
