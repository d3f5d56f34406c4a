"""The leakage stage: the audit of the core-valid groups, part by part, so that an interrupted one goes on.

Source: paper VI-A; spec/13-leakage.md.
"""

from __future__ import annotations

from pathlib import Path

from branchdrive.contract.layout import LEAKAGE_FILE
from branchdrive.leakage.audit import Progress, audit_key
from branchdrive.leakage.classifier import SequenceClassifier, Unavailable, sequence_classifier
from branchdrive.leakage.protocol import AuditProtocol
from branchdrive.leakage.replays import replay_inputs
from branchdrive.release.audit_process import AuditTask, audit_in_own_process
from branchdrive.release.layers import BuiltLayers
from branchdrive.release.parts import StoredParts
from branchdrive.release.scan import RawScan

__all__ = ["build_leakage"]


def build_leakage(
    scan: RawScan,
    layers: BuiltLayers,
    area: Path,
    *,
    seed: int,
    protocol: AuditProtocol | None = None,
    classifier: SequenceClassifier | Unavailable | None = None,
    progress: Progress | None = None,
) -> None:
    """Audit what precedes the branch in the replays of the core-valid groups.

    Args:
        scan: The raw layer.
        layers: Canonical and quality layer.
        area: Working area of the build; finished parts wait there for a build that goes on.
        seed: Of everything random.
        protocol: Numbers of the audit; None is the default.
        classifier: Of the recurrent tests; None is the installed one, if there is any.
        progress: Called with parts done, parts in total, and the name of the next.

    Raises:
        ToolError: The audit's process died.
    """
    inputs = replay_inputs(scan.rows["replays"], layers.frames["group_quality"], scan.descriptor.action_bank)
    classifier = classifier or sequence_classifier()
    key = audit_key(inputs, seed=seed, protocol=protocol, sequence_classifier=classifier)
    task = AuditTask(inputs, seed, protocol, classifier)
    layers.put_document(LEAKAGE_FILE, audit_in_own_process(task, StoredParts.of(area, key), progress))
