"""BranchDrive: branch-structured driving datasets - contract, reader, writer and validator.

The names below are the public interface; everything else is private. They load on first use, so
that importing the package costs nothing; the first use raises `PlatformError` where the machine lacks what they need.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from branchdrive.collector.collection import collect_dataset, describe
    from branchdrive.collector.contact import touched
    from branchdrive.collector.frame import Frame, box_centre, full_extents
    from branchdrive.collector.group import collect_group
    from branchdrive.collector.opendrive import read_opendrive
    from branchdrive.collector.program import collector_main
    from branchdrive.collector.report import CollectionReport, GroupReport
    from branchdrive.collector.route import route_columns, to_ego_frame
    from branchdrive.collector.town import crossing_element, lane_element, sign_element, stop_line_element
    from branchdrive.collector.trigger import Signal, Trigger, brake_trigger
    from branchdrive.collector.world import Actor, CameraWorld, Decision, Observation, Scene, World, WorldError
    from branchdrive.contract.bank import ActionBank, load_action_bank
    from branchdrive.contract.camera import PinholeCamera, TopDownCamera
    from branchdrive.contract.descriptor import (
        Collection,
        DeclaredEncoding,
        Descriptor,
        Driver,
        ReplayNoise,
        Software,
        Tolerances,
        Vehicle,
    )
    from branchdrive.contract.encoding import encode_bank, encode_policy, encoding_digest
    from branchdrive.contract.policy import ActuatorRule, Command, Policy
    from branchdrive.driving.feature import InputContract
    from branchdrive.driving.risk import risk_evidence
    from branchdrive.engine.cache import Cache
    from branchdrive.engine.finding import Finding
    from branchdrive.engine.report import Report
    from branchdrive.engine.rollout import check_rollout
    from branchdrive.engine.validate import validate
    from branchdrive.engine.waiver import Waiver, load_waivers
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
    from branchdrive.formats.place import open_store
    from branchdrive.model.contract import (
        MixedInputs,
        ModelTargets,
        ObjectsInputs,
        PrivilegedInputs,
        SensorInputs,
    )
    from branchdrive.model.reader import ModelLayer, open_model
    from branchdrive.raw.group import BranchGroup
    from branchdrive.raw.media.camera_frames import CameraFrames
    from branchdrive.raw.reader import Dataset, open_dataset
    from branchdrive.raw.rollout import Rollout
    from branchdrive.runtime.executor import Executor, isolated
    from branchdrive.runtime.ray_executor import ray_executor
    from branchdrive.writer.group_writer import GroupWriter
    from branchdrive.writer.rollout_writer import RolloutWriter
    from branchdrive.writer.writer import DatasetWriter

__all__ = [
    "ActionBank",
    "Actor",
    "ActuatorRule",
    "BranchDriveError",
    "BranchGroup",
    "Cache",
    "CameraFrames",
    "CameraWorld",
    "Collection",
    "CollectionReport",
    "Command",
    "ContractError",
    "Dataset",
    "DatasetError",
    "DatasetWriter",
    "Decision",
    "DeclaredEncoding",
    "DecodeError",
    "Descriptor",
    "Driver",
    "Executor",
    "Finding",
    "Frame",
    "GroupReport",
    "GroupWriter",
    "InputContract",
    "LimitError",
    "MixedInputs",
    "ModelLayer",
    "ModelTargets",
    "ObjectsInputs",
    "Observation",
    "PinholeCamera",
    "PlatformError",
    "Policy",
    "PrivilegedInputs",
    "ReplayNoise",
    "Report",
    "Rollout",
    "RolloutWriter",
    "Scene",
    "SensorInputs",
    "Signal",
    "Software",
    "Tolerances",
    "ToolError",
    "TopDownCamera",
    "Trigger",
    "UsageError",
    "Vehicle",
    "Waiver",
    "World",
    "WorldError",
    "box_centre",
    "brake_trigger",
    "check_rollout",
    "collect_dataset",
    "collect_group",
    "collector_main",
    "crossing_element",
    "describe",
    "encode_bank",
    "encode_policy",
    "encoding_digest",
    "full_extents",
    "isolated",
    "lane_element",
    "load_action_bank",
    "load_waivers",
    "open_dataset",
    "open_model",
    "open_store",
    "ray_executor",
    "read_opendrive",
    "risk_evidence",
    "route_columns",
    "sign_element",
    "stop_line_element",
    "to_ego_frame",
    "touched",
    "validate",
]

_HOME = {
    "ActionBank": "contract.bank",
    "Actor": "collector.world",
    "ActuatorRule": "contract.policy",
    "BranchDriveError": "errors",
    "BranchGroup": "raw.group",
    "Cache": "engine.cache",
    "CameraFrames": "raw.media.camera_frames",
    "CameraWorld": "collector.world",
    "Collection": "contract.descriptor",
    "CollectionReport": "collector.report",
    "Command": "contract.policy",
    "ContractError": "errors",
    "Dataset": "raw.reader",
    "DatasetError": "errors",
    "DatasetWriter": "writer.writer",
    "Decision": "collector.world",
    "DeclaredEncoding": "contract.descriptor",
    "DecodeError": "errors",
    "Descriptor": "contract.descriptor",
    "Driver": "contract.descriptor",
    "Executor": "runtime.executor",
    "Finding": "engine.finding",
    "Frame": "collector.frame",
    "GroupReport": "collector.report",
    "GroupWriter": "writer.group_writer",
    "InputContract": "driving.feature",
    "LimitError": "errors",
    "MixedInputs": "model.contract",
    "ModelLayer": "model.reader",
    "ModelTargets": "model.contract",
    "ObjectsInputs": "model.contract",
    "Observation": "collector.world",
    "PinholeCamera": "contract.camera",
    "PlatformError": "errors",
    "Policy": "contract.policy",
    "PrivilegedInputs": "model.contract",
    "ReplayNoise": "contract.descriptor",
    "Report": "engine.report",
    "Rollout": "raw.rollout",
    "RolloutWriter": "writer.rollout_writer",
    "Scene": "collector.world",
    "SensorInputs": "model.contract",
    "Signal": "collector.trigger",
    "Software": "contract.descriptor",
    "Tolerances": "contract.descriptor",
    "ToolError": "errors",
    "TopDownCamera": "contract.camera",
    "Trigger": "collector.trigger",
    "UsageError": "errors",
    "Vehicle": "contract.descriptor",
    "Waiver": "engine.waiver",
    "World": "collector.world",
    "WorldError": "collector.world",
    "box_centre": "collector.frame",
    "brake_trigger": "collector.trigger",
    "check_rollout": "engine.rollout",
    "collect_dataset": "collector.collection",
    "collect_group": "collector.group",
    "collector_main": "collector.program",
    "crossing_element": "collector.town",
    "describe": "collector.collection",
    "encode_bank": "contract.encoding",
    "encode_policy": "contract.encoding",
    "encoding_digest": "contract.encoding",
    "full_extents": "collector.frame",
    "isolated": "runtime.executor",
    "lane_element": "collector.town",
    "load_action_bank": "contract.bank",
    "load_waivers": "engine.waiver",
    "open_dataset": "raw.reader",
    "open_model": "model.reader",
    "open_store": "formats.place",
    "ray_executor": "runtime.ray_executor",
    "risk_evidence": "driving.risk",
    "read_opendrive": "collector.opendrive",
    "route_columns": "collector.route",
    "sign_element": "collector.town",
    "stop_line_element": "collector.town",
    "to_ego_frame": "collector.route",
    "touched": "collector.contact",
    "validate": "engine.validate",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'branchdrive' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    if _HOME[name] != "errors":
        import_module("branchdrive.runtime.environment").check_environment()
    value = getattr(import_module(f"branchdrive.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
