"""The descriptor that the collector writes for its datasets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version

from branchdrive.contract.bank import load_action_bank
from branchdrive.contract.descriptor import Collection, DeclaredEncoding, Descriptor, Software
from branchdrive.contract.encoding import ENCODING_NAME, ENCODING_WIDTH, encoding_digest
from branchdrive_reference.collect.plan import select_scenarios
from branchdrive_reference.version import COLLECTOR_NAME, COLLECTOR_VERSION, SIMULATOR_NAME, SIMULATOR_VERSION

__all__ = ["collection_descriptor"]


@cache
def _simulator_version() -> str:
    """Version of the simulator and of the libraries that decide its bits: a collection never mixes them."""
    libraries = (f"{name}.{version(name)}" for name in ("numba", "numpy", "pymunk"))
    return f"{SIMULATOR_VERSION}+{'.'.join(libraries)}"


def collection_descriptor(
    seed: int,
    *,
    replay_noise: float = 0.0,
    faults: Mapping[str, float] | None = None,
    scenario_types: Sequence[str] = (),
) -> Descriptor:
    """Descriptor of a collection; the number of groups is not part of it.

    Args:
        seed: Seed of the collection.
        replay_noise: Strength of the noise of replays.
        faults: Rates of injected faults by name.
        scenario_types: Scenario types to plan; all registered ones if none is named.

    Raises:
        UsageError: A scenario type is not registered.
    """
    bank = load_action_bank()
    return Descriptor(
        dataset_id=f"branchdrive-reference-s{seed}",
        dataset_version="0.1.0",
        title="Matched interventions in the BranchDrive reference world",
        licence="CC-BY-4.0",
        simulator=Software(name=SIMULATOR_NAME, version=_simulator_version()),
        collector=Software(name=COLLECTOR_NAME, version=COLLECTOR_VERSION),
        streams=("ego_route_state", "actor_risk_evidence", "controls", "route_result"),
        action_bank=bank,
        action_encoding=DeclaredEncoding(name=ENCODING_NAME, width=ENCODING_WIDTH, sha256=encoding_digest(bank)),
        collection=Collection(
            seed=seed,
            replay_noise=replay_noise,
            faults={str(name): rate for name, rate in sorted((faults or {}).items())},
            scenario_types=select_scenarios(scenario_types),
        ),
    )
