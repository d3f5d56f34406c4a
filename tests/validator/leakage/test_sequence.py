"""How the core finds a sequence classifier, and what it says where there is none."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest

from branchdrive.leakage import sequence
from branchdrive.leakage.sequence import ENTRY_POINTS, Unavailable, sequence_classifier


def offer(monkeypatch: pytest.MonkeyPatch, *values: str) -> None:
    points = [EntryPoint(f"c{len(values) - i}", value, ENTRY_POINTS) for i, value in enumerate(values)]
    monkeypatch.setattr(sequence, "entry_points", lambda group: points if group == ENTRY_POINTS else [])


def test_the_only_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "math:pi")
    assert sequence_classifier() == pytest.approx(3.14159, abs=1e-5)


def test_none_of_several_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "math:tau", "math:pi")
    reason = "several sequence classifiers are installed: `c1`, `c2`; uninstall all but one"
    assert sequence_classifier() == Unavailable(reason)


def test_a_missing_package_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, "no_such_package.gru:gru")
    reason = "needs the package `no_such_package`: pip install 'branchdrive[models]'"
    assert sequence_classifier() == Unavailable(reason)


def test_nothing_installed_is_said_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch)
    found = sequence_classifier()
    assert isinstance(found, Unavailable)
    assert "pip install 'branchdrive[models]'" in found.reason
