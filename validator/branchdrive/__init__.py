"""BranchDrive: branch-structured driving datasets - contract, reader, writer and validator.

The names below are the public interface; everything else is private. They load on first use, so
that importing the package costs nothing; the first use raises `PlatformError` where the machine lacks what they need.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branchdrive.audit.engine import validate
    from branchdrive.audit.finding import Finding
    from branchdrive.audit.report import Report
    from branchdrive.audit.rollout import check_rollout
    from branchdrive.audit.waiver import Waiver, load_waivers
    from branchdrive.audit.worker import Executor, isolated
    from branchdrive.contract.bank import ActionBank, load_action_bank
    from branchdrive.contract.descriptor import Camera, Collection, DeclaredEncoding, Descriptor, Software, Tolerances
    from branchdrive.contract.encoding import encode_bank, encode_policy, encoding_digest
    from branchdrive.contract.policy import ActuatorRule, Command, Policy
    from branchdrive.dataset.group import BranchGroup
    from branchdrive.dataset.group_writer import GroupWriter
    from branchdrive.dataset.model_input import MixedInputs, ModelTargets, PrivilegedInputs, SensorInputs
    from branchdrive.dataset.model_layer import ModelLayer, open_model
    from branchdrive.dataset.reader import Dataset, open_dataset
    from branchdrive.dataset.rollout import Rollout
    from branchdrive.dataset.rollout_writer import RolloutWriter
    from branchdrive.dataset.writer import DatasetWriter
    from branchdrive.derive.feature import InputContract
    from branchdrive.derive.risk import risk_evidence
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
    "BranchGroup": "dataset.group",
    "Camera": "contract.descriptor",
    "Collection": "contract.descriptor",
    "Command": "contract.policy",
    "ContractError": "errors",
    "Dataset": "dataset.reader",
    "DatasetError": "errors",
    "DatasetWriter": "dataset.writer",
    "DeclaredEncoding": "contract.descriptor",
    "DecodeError": "errors",
    "Descriptor": "contract.descriptor",
    "Executor": "audit.worker",
    "Finding": "audit.finding",
    "GroupWriter": "dataset.group_writer",
    "InputContract": "derive.feature",
    "LimitError": "errors",
    "MixedInputs": "dataset.model_input",
    "ModelLayer": "dataset.model_layer",
    "ModelTargets": "dataset.model_input",
    "PlatformError": "errors",
    "Policy": "contract.policy",
    "PrivilegedInputs": "dataset.model_input",
    "Report": "audit.report",
    "Rollout": "dataset.rollout",
    "RolloutWriter": "dataset.rollout_writer",
    "SensorInputs": "dataset.model_input",
    "Software": "contract.descriptor",
    "Tolerances": "contract.descriptor",
    "ToolError": "errors",
    "UsageError": "errors",
    "Waiver": "audit.waiver",
    "check_rollout": "audit.rollout",
    "encode_bank": "contract.encoding",
    "encode_policy": "contract.encoding",
    "encoding_digest": "contract.encoding",
    "isolated": "audit.worker",
    "load_action_bank": "contract.bank",
    "load_waivers": "audit.waiver",
    "open_dataset": "dataset.reader",
    "open_model": "dataset.model_layer",
    "risk_evidence": "derive.risk",
    "validate": "audit.engine",
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
