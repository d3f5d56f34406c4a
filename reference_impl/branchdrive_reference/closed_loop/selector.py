"""Selectors that drive: each names one candidate of the bank at a decision, from what it may see there.

====================  ================================================================================
``nominal``           the expert goes on
an action key         that candidate, at every decision; ``constants`` stands for all of them
``action_prior``      the constant candidate of the greatest mean utility in training
a baseline            by its estimate from training, as the protocol declares it
``E-MODEL``           by the mean prediction of the seeds of a locked model, from its ONNX export
``oracle``            by the executed utility, from driving every candidate ahead: what no vehicle could know
``NAME=COMMAND``      by a program of others, see `external`
====================  ================================================================================

Learned selectors have seen the branches of training alone; a later decision is made in states that no training branch
has.
"""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.benchmark.protocol.selection import ENSEMBLE, ORACLE, Baseline
from branchdrive.benchmark.ranking.baseline import estimate, is_seen
from branchdrive.benchmark.ranking.context import Contexts, contexts_of
from branchdrive.benchmark.ranking.measure import best_fixed, choose
from branchdrive.contract.bank import ActionBank
from branchdrive.driving.utility import Profile, Scale, predicted_utility, utility
from branchdrive.errors import UsageError
from branchdrive.model.objects import OBJECTS
from branchdrive_reference.benchmark.release import Release, baseline_contexts, benchmark_data
from branchdrive_reference.closed_loop.external import External
from branchdrive_reference.closed_loop.sight import NOW, Sight

__all__ = ["ACTION_PRIOR", "CONSTANTS", "NOMINAL", "Selector", "Training", "open_selectors"]

Array = NDArray[np.float64]

NOMINAL = "nominal"
ACTION_PRIOR = "action_prior"
CONSTANTS = "constants"


class Selector(Protocol):
    """Decides; processes hand it to each other, so that it is to be pickled."""

    @property
    def name(self) -> str:
        """Its name in tables."""

    @property
    def sees(self) -> str:
        """What it sees."""

    def __call__(self, sight: Sight, /) -> int:
        """Place of its candidate in the bank."""


@dataclass(frozen=True, eq=False)
class Training:
    """What selectors know from training.

    Attributes:
        bank: Candidates.
        profile_name: Name of the preference.
        profile: The preference.
        scale: Quantiles of the targets.
        groups: Ids of the training groups ``[n]``.
        utilities: Their executed utilities ``[n, A]``.
        baselines: Declared baselines.
        contexts: What they see of training groups; ``None`` where none is declared.
    """

    bank: ActionBank
    profile_name: str
    profile: Profile
    scale: Scale
    groups: tuple[str, ...]
    utilities: Array
    baselines: tuple[Baseline, ...]
    contexts: Contexts | None

    @classmethod
    def of(cls, release: Release, protocol: BenchmarkProtocol, profile_name: str) -> Training:
        """What a release and a protocol say.

        Raises:
            UsageError: The protocol has no such profile.
            DatasetError: A table cannot be read, or nothing is in training.
        """
        preferences = protocol.preferences
        if profile_name not in preferences:
            raise UsageError(f"no profile {profile_name!r}; the protocol declares {', '.join(preferences)}")
        data, profile = benchmark_data(release), preferences[profile_name]
        scale, part = utility_scale(protocol, data), data.part(protocol.partitions.fit)
        return cls(
            release.layer.descriptor.action_bank,
            profile_name,
            profile,
            scale,
            part.groups,
            utility(part.targets, scale, profile),
            tuple(protocol.baselines),
            baseline_contexts(release, protocol, data),
        )


@dataclass(frozen=True)
class _Fixed:
    name: str
    place: int
    sees: str = "nothing"

    def __call__(self, _: Sight) -> int:
        return self.place


@dataclass(frozen=True, eq=False)
class _Estimated:
    baseline: Baseline
    training: Training

    @property
    def name(self) -> str:
        return self.baseline.name

    @property
    def sees(self) -> str:
        return self.baseline.sees

    def __call__(self, sight: Sight) -> int:
        training, known = self.training, self.training.contexts
        if known is None:
            raise UsageError(f"the baseline {self.name!r} has no contexts of training groups")
        now = contexts_of(sight.frames().__getitem__, [NOW], training.baselines)
        found = estimate(self.baseline, known.joined(now), training.groups, training.utilities, [NOW])
        return int(choose(found)[0])


@dataclass(frozen=True, eq=False)
class _Exported:
    name: str
    path: Path
    training: Training = field(repr=False)
    sees: str

    @cached_property
    def _session(self) -> Any:
        from branchdrive_reference.benchmark.onnx_export import open_selector

        return open_selector(self.path.read_bytes())

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_session"}

    def __call__(self, sight: Sight) -> int:
        inputs = [one.name for one in self._session.get_inputs()]
        history = sight.history() | (sight.objects() if OBJECTS in inputs else {})
        (targets,) = self._session.run(["targets"], {name: history[name] for name in inputs})
        return int(choose(predicted_utility(targets, self.training.scale, self.training.profile)))


@dataclass(frozen=True, eq=False)
class _Oracle:
    training: Training = field(repr=False)
    name: str = ORACLE
    sees: str = "the executed future of every candidate"

    def __call__(self, sight: Sight) -> int:
        found = utility(sight.look_ahead(), self.training.scale, self.training.profile)
        if not np.isfinite(found).all():  # the drive ends within a window, or no actor is near: nothing to compare
            return self.training.bank.nominal_index
        return int(choose(found))


def open_selectors(
    names: Sequence[str], training: Training, exported: Callable[[str], tuple[Path, str]]
) -> tuple[dict[str, Selector], dict[str, dict[str, Any]]]:
    """Selectors by name, in the given order, and what a lock says of each.

    Args:
        names: As the table above has them; a name that is given twice counts once.
        training: What they know from training.
        exported: Gives the file of the ONNX export of a model, and what the model sees.

    Raises:
        UsageError: There is no selector of a name, or a program is called like one of this package.
    """
    bank, found = training.bank, dict[str, Selector]()
    baselines = {baseline.name: baseline for baseline in training.baselines}
    about: dict[str, dict[str, Any]] = {}
    taken = (NOMINAL, CONSTANTS, ACTION_PRIOR, *baselines, ORACLE)
    wanted = [one for name in names for one in (_constants(bank) if name == CONSTANTS else [name])]
    for text in wanted:
        name, is_external, command = text.partition("=")
        more: Mapping[str, Any] = {}
        selector: Selector
        if is_external:
            words = _words(text, command)
            if name in (*taken, *bank.keys) or name.startswith(ENSEMBLE):
                raise UsageError(f"--selector {text!r}: {name!r} is a selector of this package; take another name")
            selector, more = External(name, words, bank.keys), {"command": list(words)}
        elif name == NOMINAL:
            selector = _Fixed(NOMINAL, bank.nominal_index)
        elif name == ACTION_PRIOR:
            selector = _Fixed(name, best_fixed(training.utilities))
        elif name in bank.keys:
            selector = _Fixed(name, bank.keys.index(name))
        elif name in baselines:
            if training.contexts is None or not is_seen(baselines[name], training.contexts):
                raise UsageError(f"the dataset has not what the baseline {name!r} sees; leave it out")
            selector = _Estimated(baselines[name], training)
        elif name.startswith(ENSEMBLE):
            path, sees = exported(name.removeprefix(ENSEMBLE))
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            selector, more = _Exported(name, path, training, sees), {"onnx_sha256": digest}
        elif name == ORACLE:
            selector = _Oracle(training)
        else:
            there = [*taken, f"{ENSEMBLE}MODEL", "NAME=COMMAND"]
            raise UsageError(f"no selector {text!r}; there are {', '.join(there)} and the candidates of the bank")
        if name in found and about[name] != {"name": name, "sees": selector.sees, **more}:
            raise UsageError(f"two selectors are called {name!r}; give each a name of its own")
        found[name] = selector
        about[name] = {"name": name, "sees": selector.sees, **more}
    return found, about


def _constants(bank: ActionBank) -> list[str]:
    return [policy.key for policy in bank.interventions]


def _words(text: str, command: str) -> tuple[str, ...]:
    try:
        words = tuple(shlex.split(command))
    except ValueError as error:
        raise UsageError(f"--selector {text!r}: {error}") from error
    if not words or not text.partition("=")[0]:
        raise UsageError(f"--selector {text!r}: give NAME=COMMAND, a name and a program with its arguments")
    return words
