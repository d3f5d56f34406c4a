"""BranchDrive: branch-structured driving datasets - contract, reader, writer and validator.

The names below are the public interface; everything else is private. They load on first use, so
that importing the package costs nothing; the first use raises `PlatformError` where the machine lacks what they need.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branchdrive.contract.bank import ActionBank, load_action_bank
    from branchdrive.contract.descriptor import Camera, Collection, DeclaredEncoding, Descriptor, Software, Tolerances
    from branchdrive.contract.encoding import encode_bank, encode_policy, encoding_digest
    from branchdrive.contract.policy import ActuatorRule, Command, Policy
    from branchdrive.driving.feature import InputContract
    from branchdrive.driving.risk import risk_evidence
    from branchdrive.engine.finding import Finding
    from branchdrive.engine.report import Report
    from branchdrive.engine.rollout import check_rollout
    from branchdrive.engine.validate import validate
    from branchdrive.engine.waiver import Waiver, load_waivers
    from branchdrive.engine.worker import Executor, isolated
    from branchdrive.errors import (
        BranchDriveError,
        ContractError,
        DatasetError,
        DecodeError,
        LimitError,
        PlatformError,
        ToolError,
        UsageError,
    )
    from branchdrive.model.contract import MixedInputs, ModelTargets, PrivilegedInputs, SensorInputs
    from branchdrive.model.reader import ModelLayer, open_model
    from branchdrive.raw.group import BranchGroup
    from branchdrive.raw.reader import Dataset, open_dataset
    from branchdrive.raw.rollout import Rollout
    from branchdrive.writer.group_writer import GroupWriter
    from branchdrive.writer.rollout_writer import RolloutWriter
    from branchdrive.writer.writer import DatasetWriter

__all__ = [
    "ActionBank",
    "ActuatorRule",
    "BranchDriveError",
    "BranchGroup",
    "Camera",
    "Collection",
    "Command",
    "ContractError",
    "Dataset",
    "DatasetError",
    "DatasetWriter",
    "DeclaredEncoding",
    "DecodeError",
    "Descriptor",
    "Executor",
    "Finding",
    "GroupWriter",
    "InputContract",
    "LimitError",
    "MixedInputs",
    "ModelLayer",
    "ModelTargets",
    "PlatformError",
    "Policy",
    "PrivilegedInputs",
    "Report",
    "Rollout",
    "RolloutWriter",
    "SensorInputs",
    "Software",
    "Tolerances",
    "ToolError",
    "UsageError",
    "Waiver",
    "check_rollout",
    "encode_bank",
    "encode_policy",
    "encoding_digest",
    "isolated",
    "load_action_bank",
    "load_waivers",
    "open_dataset",
    "open_model",
    "risk_evidence",
    "validate",
]

_HOME = {
    "ActionBank": "contract.bank",
    "ActuatorRule": "contract.policy",
    "BranchDriveError": "errors",
    "BranchGroup": "raw.group",
    "Camera": "contract.descriptor",
    "Collection": "contract.descriptor",
    "Command": "contract.policy",
    "ContractError": "errors",
    "Dataset": "raw.reader",
    "DatasetError": "errors",
    "DatasetWriter": "writer.writer",
    "DeclaredEncoding": "contract.descriptor",
    "DecodeError": "errors",
    "Descriptor": "contract.descriptor",
    "Executor": "engine.worker",
    "Finding": "engine.finding",
    "GroupWriter": "writer.group_writer",
    "InputContract": "driving.feature",
    "LimitError": "errors",
    "MixedInputs": "model.contract",
    "ModelLayer": "model.reader",
    "ModelTargets": "model.contract",
    "PlatformError": "errors",
    "Policy": "contract.policy",
    "PrivilegedInputs": "model.contract",
    "Report": "engine.report",
    "Rollout": "raw.rollout",
    "RolloutWriter": "writer.rollout_writer",
    "SensorInputs": "model.contract",
    "Software": "contract.descriptor",
    "Tolerances": "contract.descriptor",
    "ToolError": "errors",
    "UsageError": "errors",
    "Waiver": "engine.waiver",
    "check_rollout": "engine.rollout",
    "encode_bank": "contract.encoding",
    "encode_policy": "contract.encoding",
    "encoding_digest": "contract.encoding",
    "isolated": "engine.worker",
    "load_action_bank": "contract.bank",
    "load_waivers": "engine.waiver",
    "open_dataset": "raw.reader",
    "open_model": "model.reader",
    "risk_evidence": "driving.risk",
    "validate": "engine.validate",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'branchdrive' has no attribute {name!r}")
    if _HOME[name] != "errors":
        import_module("branchdrive.environment").check_environment()
    value = getattr(import_module(f"branchdrive.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
