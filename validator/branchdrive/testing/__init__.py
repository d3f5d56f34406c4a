"""Hypothesis strategies for datasets, their parts and their defects; the extra `testing` brings Hypothesis.

The names below are the public interface; everything else is private. What is drawn is read from the declarations in
`schemas/`, so that a change there needs none here.
"""

from __future__ import annotations

from branchdrive.runtime.environment import extra

with extra("testing", of="branchdrive.testing"):
    from branchdrive.testing.dataset import SmallDataset
    from branchdrive.testing.defect import Defect, defects
    from branchdrive.testing.driven import OPTIONAL_STREAMS, datasets, driven_banks, scenes
    from branchdrive.testing.strategies import (
        ControlLog,
        actuator_rules,
        bank_documents,
        banks,
        bd29_banks,
        bd29_policies,
        column_values,
        commands,
        control_logs,
        descriptor_documents,
        descriptors,
        identifiers,
        masked_values,
        masks,
        policies,
        policy_documents,
        rollout_records,
    )

__all__ = [
    "OPTIONAL_STREAMS",
    "ControlLog",
    "Defect",
    "SmallDataset",
    "actuator_rules",
    "bank_documents",
    "banks",
    "bd29_banks",
    "bd29_policies",
    "column_values",
    "commands",
    "control_logs",
    "datasets",
    "defects",
    "descriptor_documents",
    "descriptors",
    "driven_banks",
    "identifiers",
    "masked_values",
    "masks",
    "policies",
    "policy_documents",
    "rollout_records",
    "scenes",
]
