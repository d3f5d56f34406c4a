"""Recurrent classifier of actions for the paper's battery: its numbers, known without torch, and what fits it.

A GRU reads the sequence of a replay, and a linear layer turns its last state into log-probabilities of the
actions; see `branchdrive_reference.leakage.gru_fit`, which loads torch. A build states the numbers in one process
and fits in another.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage" for the kind; sizes are this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

from branchdrive.leakage.classifier import SequenceScores, SequenceTask

__all__ = ["GruClassifier", "gru"]


def _torch_version() -> str:
    """Version of torch as torch has it, from its file of that alone: loading the package takes seconds.

    Raises:
        ModuleNotFoundError: There is no torch.
    """
    package = find_spec("torch")
    if package is None or package.origin is None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")
    spec = spec_from_file_location("torch_version", Path(package.origin).with_name("version.py"))
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError("torch has no file of its version", name="torch")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return str(module.__version__)


_TORCH_VERSION = _torch_version()


@dataclass(frozen=True)
class GruClassifier:
    """A sequence classifier.

    Attributes:
        hidden: Width of the recurrent state.
        batch_groups: Groups of a batch.
        learning_rate: Of Adam.
        max_epochs: Epochs at most, at least 1.
        patience: Epochs without a lesser validation loss after which training ends.
    """

    hidden: int = 24
    batch_groups: int = 16
    learning_rate: float = 1e-3
    max_epochs: int = 30
    patience: int = 5

    @property
    def settings(self) -> Mapping[str, int | float | str]:
        """Everything that is fixed before data are seen."""
        return {"name": "gru", "torch": _TORCH_VERSION, **asdict(self)}

    def __call__(self, task: SequenceTask, *, seed: int) -> SequenceScores:
        """Log-probabilities of the rows to test.

        Args:
            task: Standardised sequences, each partition with at least one group.
            seed: Of weights and batches, below 2**64.
        """
        from branchdrive_reference.leakage.gru_fit import fitted_scores

        return fitted_scores(self, task, seed=seed)


gru = GruClassifier()
"""The classifier as the audit finds it."""
