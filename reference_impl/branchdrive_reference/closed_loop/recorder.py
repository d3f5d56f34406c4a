"""Drives as a raw dataset, which a validator judges like any other: their nominal passes, and each drive once.

Source: spec/04-policies.md#drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from branchdrive.collector.recording import Record
from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import DECISIONS, STREAMS
from branchdrive.contract.descriptor import Descriptor, ReplayNoise
from branchdrive.writer.group_writer import GroupWriter
from branchdrive_reference.closed_loop.arm import Arm, Condition
from branchdrive_reference.closed_loop.course import Driven
from branchdrive_reference.closed_loop.site import Field, Nominal, Place
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION

__all__ = ["DRIVES_DIR", "Recorder", "drives_descriptor"]

DRIVES_DIR = "dataset"
"""Folder of the dataset in that of a run."""

_NOMINAL_VARIANT = "nominal-pass"
_LEFT_OUT = ("description", "citation", "doi", "url")
"""What a descriptor says of the release alone."""


def drives_descriptor(release: Descriptor, field: Field, seed: int, conditions: Sequence[Condition]) -> Descriptor:
    """Descriptor of the drives that selectors of a release made.

    Args:
        release: Its descriptor.
        field: The world.
        seed: Seed of the population.
        conditions: Noise; the strongest noise of replays is declared.
    """
    document = release.model_dump(mode="json")
    collection = document["collection"]
    if field.has_replay_noise:
        strength = max(condition.replay for condition in conditions)
        collection["replay_noise"] = ReplayNoise.of_strength(strength).model_dump(mode="json")
    return Descriptor.model_validate(
        {
            **{name: value for name, value in document.items() if name not in _LEFT_OUT},
            "dataset_id": f"drives-s{seed}-of-{release.dataset_id}"[:128],
            "dataset_version": "0.1.0",
            "title": f"Drives of selectors: {release.title}"[:200],
            "simulator": field.software.model_dump(mode="json"),
            "collector": {"name": COLLECTOR_NAME, "version": COLLECTOR_VERSION},
            "streams": [*(name for name in release.streams if not STREAMS[name].cameras), DECISIONS],
            "cameras": [],
            "layers": ["raw"],
            "collection": {
                "seed": seed,
                "replay_noise": collection["replay_noise"],
                "branches": collection.get("branches", {}),
                "scenario_types": collection["scenario_types"],
            },
        }
    )


class _Attempt(NamedTuple):
    """What names an attempt in its group."""

    role: str
    key: str
    variant: str
    number: int


@dataclass(frozen=True)
class Recorder:
    """Writes the drives of a group; what an interrupted run wrote of it stays.

    Attributes:
        root: Folder of the dataset.
        descriptor: Its descriptor.
        places: Place of each group in it.
    """

    root: Path
    descriptor: Descriptor
    places: Mapping[str, int]

    def write(self, place: Place, nominal: Nominal | None, drives: Sequence[tuple[Arm, Driven]]) -> None:
        """Write and close a group.

        Args:
            place: The group.
            nominal: Its nominal pass; ``None`` where the group is left out, which leaves no trace then.
            drives: Its drives, each with the first arm that made it.
        """
        with GroupWriter(self.root, self.descriptor, place.group_id, self.places[place.group_id]) as writer:
            if nominal is None:
                return
            bank = self.descriptor.action_bank
            attempt = _Attempt("nominal", bank.nominal.key, _NOMINAL_VARIANT, 1)
            nominal_id = self._keep(writer, place, attempt, nominal.record, nominal, None)
            attempts: dict[tuple[str, str], int] = {}
            for arm, driven in drives:
                variant, key = _variant(arm), bank.policies[driven.choices[0]].key
                attempts[variant, key] = number = attempts.get((variant, key), 0) + 1
                attempt = _Attempt("drive", key, variant, number)
                self._keep(writer, place, attempt, _decided(driven, nominal, bank), nominal, nominal_id)

    def _keep(
        self,
        writer: GroupWriter,
        place: Place,
        attempt: _Attempt,
        record: Record,
        nominal: Nominal,
        nominal_id: str | None,
    ) -> str:
        """Write an attempt, unless it is there; its id."""
        role, key, variant, number = attempt
        found = writer.find(role, key, number, protocol_variant=variant)
        if found is not None:
            return found.rollout_id
        begun = writer.begin_rollout(role=role, action_key=key, protocol_variant=variant)
        record.append_to(begun)
        simulator, collector = self.descriptor.simulator, self.descriptor.collector
        fields = {
            **record.fields,
            **nominal.branch.columns(nominal_id or begun.rollout_id),
            "nominal_rollout_id": nominal_id,
            "scenario_type": place.scenario_type,
            "seed": place.seed,
            "repetition": 0,
            "simulator_version": f"{simulator.name} {simulator.version}",
            "collector_version": f"{collector.name} {collector.version}",
            "provenance": f"{role} of planned group {place.index}, closed loop, executed from tick 0",
        }
        begun.finish(**fields)
        return begun.rollout_id


def _variant(arm: Arm) -> str:
    """Protocol of a drive: when decisions are made, and under which noise of replays."""
    schedule, noise = arm.schedule, arm.condition.replay
    name = f"every-{schedule.every_ticks}-decisions-{schedule.num_decisions}"
    return f"{name}-replay-noise-{noise:g}" if noise else name


def _decided(driven: Driven, nominal: Nominal, bank: ActionBank) -> Record:
    made = zip(driven.ticks, (bank.policies[choice] for choice in driven.choices), strict=True)
    return driven.record.with_decisions([*made], nominal.applied)
