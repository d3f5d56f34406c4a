"""The leakage stage: the audit of the core-valid groups, part by part, so that an interrupted one goes on.

Source: paper VI-A; spec/13-leakage.md.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from branchdrive.audit.extract.replay_input import replay_inputs
from branchdrive.build.layers import BuiltLayers
from branchdrive.build.scan import RawScan
from branchdrive.dataset.durable import make_dir, replace_file
from branchdrive.dataset.layout import LEAKAGE_FILE
from branchdrive.derive.leakage.audit import AuditProtocol, Progress, audit_key, audit_leakage
from branchdrive.derive.leakage.metamorphic import metamorphic_document
from branchdrive.derive.leakage.sequence import SequenceClassifier, Unavailable, sequence_classifier

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
    """
    inputs = replay_inputs(scan.extract.replays, layers.frames["group_quality"], scan.descriptor.action_bank)
    classifier = classifier or sequence_classifier()
    key = audit_key(inputs, seed=seed, protocol=protocol, sequence_classifier=classifier)
    folder = area / f"leakage-{key[:16]}"
    make_dir(folder)

    def remember(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        path = folder / f"{name.replace('/', '-')}.json"
        if path.is_file():
            with suppress(ValueError):  # what cannot be read is computed again
                kept: dict[str, Any] = json.loads(path.read_bytes())
                return kept
        result = compute()
        replace_file(path, json.dumps(result, allow_nan=False).encode())
        return result

    document = audit_leakage(
        inputs,
        metamorphic=metamorphic_document(scan.extract.changed or {}, len(scan.extract.route_groups)),
        seed=seed,
        protocol=protocol,
        sequence_classifier=classifier,
        remember=remember,
        progress=progress,
    )
    layers.put_document(LEAKAGE_FILE, document)
