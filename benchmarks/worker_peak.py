"""Peak memory of a worker that audits shards, by the number of groups in a shard.

Workers import this module for their tasks, so it imports nothing but the core, whose memory is in the peak.
"""

from __future__ import annotations

import os
from pathlib import Path

from benchmarks.memory import peak_bytes
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.shard import ShardTask, audit_shard
from branchdrive.files.survey import take_survey
from branchdrive.formats.folder import Folder
from branchdrive.runtime.executor import isolated

__all__ = ["worker_peak_bytes"]


def worker_peak_bytes(root: Path) -> int:
    """Largest resident memory of a worker that audits every shard of a raw layer in turn."""
    survey = take_survey(Folder(root))
    selected = frozenset(CATALOGUE)
    tasks = [
        ShardTask(survey.folder, folder, tuple(file.path for file in files), survey.descriptor, selected, True)
        for folder, files in survey.shard_folders.items()
    ]
    return max(peak for _, peak in isolated(1)(_peak_bytes, tasks) if isinstance(peak, int))


def _peak_bytes(task: ShardTask) -> int:
    """Largest resident memory of this process after auditing a shard.

    Read from `/proc`: resource usage would count what the parent held when it started the process.
    """
    audit_shard(task)
    return peak_bytes(os.getpid())
