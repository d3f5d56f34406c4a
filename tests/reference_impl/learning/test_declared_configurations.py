"""The normative protocol declares the models that this implementation trains."""

from __future__ import annotations

from branchdrive.derive.benchmark.protocol import default_protocol
from branchdrive_reference.learning.configuration import CONFIGURATIONS


def test_default_protocol_declares_the_configurations() -> None:
    declared = {model.id: model for model in default_protocol().models}
    assert list(declared) == list(CONFIGURATIONS)
    for name, configuration in CONFIGURATIONS.items():
        assert declared[name].configuration == configuration.record
        assert declared[name].config_digest == configuration.digest
        assert tuple(declared[name].seeds) == configuration.seeds
        assert declared[name].contract == configuration.model.contract
