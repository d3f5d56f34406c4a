"""Tests of models that a protocol does not declare: each against the model whose selections are guarded.

Predictions of others are to be compared with the best of the declared models, though no family foresaw them. Such tests
stand beside the declared ones, in no family and without adjustment: they explore.

Source: this project's choice; spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, Member
from branchdrive.benchmark.protocol.selection import LEARNED

__all__ = ["MAX_MODELS", "undeclared_predictions", "undeclared_rankings"]

MAX_MODELS = 16
"""Undeclared models that are compared, the first by name; tests of hundreds would take memory without a bound."""

_ERRORS, _MEASURES = ("macro_nmae", "ade_m"), ("value", "regret")


def undeclared_predictions(protocol: BenchmarkProtocol, models: Collection[str]) -> list[Member]:
    """Tests of errors, of those among the judged `models` that are not declared."""
    pairs = _pairs(protocol, models)
    return _unnamed(protocol, (Member(left=a, right=b, metric=metric) for a, b in pairs for metric in _ERRORS))


def undeclared_rankings(
    protocol: BenchmarkProtocol, models: Collection[str], profiles: Collection[str]
) -> list[Member]:
    """Tests of selections by them, under every ranked profile."""
    return _unnamed(
        protocol,
        (
            Member(left=LEARNED + a, right=LEARNED + b, metric=metric, profile=profile)
            for a, b in _pairs(protocol, models)
            for profile in profiles
            for metric in _MEASURES
        ),
    )


def _pairs(protocol: BenchmarkProtocol, models: Collection[str]) -> list[tuple[str, str]]:
    reference = protocol.guard.model
    others = sorted(model for model in models if protocol.model(model) is None)[:MAX_MODELS]
    return [(model, reference) for model in others if reference in models]


def _unnamed(protocol: BenchmarkProtocol, members: Iterable[Member]) -> list[Member]:
    """Those whose name no declared test has."""
    declared = {member.name for family in protocol.families for member in family.members}
    return [member for member in members if member.name not in declared]
