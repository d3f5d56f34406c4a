"""Spec limits are read from their declaration, all of them."""

from __future__ import annotations

import dataclasses

import pytest
from tests.each import each

from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.contract.resources import load_resource

DECLARED = load_resource("limits.json")["limits"]


def test_every_declared_limit_is_read_and_no_other() -> None:
    assert dataclasses.asdict(spec_limits()) == {name: limit["value"] for name, limit in DECLARED.items()}


@each("name", [field.name for field in dataclasses.fields(Limits)])
def test_limits_are_positive_integers(name: str) -> None:
    value = getattr(spec_limits(), name)
    assert type(value) is int
    assert value > 0


def test_limits_are_frozen_and_shared() -> None:
    assert spec_limits() is spec_limits()
    with pytest.raises(dataclasses.FrozenInstanceError):
        spec_limits().max_files = 1


def test_documents_fit_their_own_limits() -> None:
    limits = spec_limits()
    assert limits.max_document_bytes <= limits.max_manifest_bytes <= limits.max_table_bytes
    assert limits.max_document_depth < 500, "a JSON parser recurses far below Python's own limit"
