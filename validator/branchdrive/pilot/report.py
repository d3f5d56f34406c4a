"""The pilot report: all sections, in the order in which a collector is put right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.exit_code import EXIT_FAILED, EXIT_INVALID, EXIT_SUCCESS
from branchdrive.pilot.action_response import action_response
from branchdrive.pilot.column import columns
from branchdrive.pilot.conformance import conformance
from branchdrive.pilot.cost import cost
from branchdrive.pilot.crash_drill import crash_drill
from branchdrive.pilot.determinism import determinism
from branchdrive.pilot.funnel import funnel_forecast
from branchdrive.pilot.leakage_power import leakage_power
from branchdrive.pilot.physics import physics
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.replay import replay_noise
from branchdrive.pilot.reruns import Reruns
from branchdrive.pilot.route_plan import route_plan
from branchdrive.pilot.section import Concern, Section
from branchdrive.pilot.timing import timing_of

__all__ = ["PilotReport", "examine_pilot"]


_CONSEQUENCES = {"conformance": 1, "funnel": 2}
"""Sections whose concerns mostly go away with those of others, and their order."""


@dataclass(frozen=True)
class PilotReport:
    """What was found out about a pilot.

    Attributes:
        pilot: What was examined.
        sections: In order.
    """

    pilot: Pilot
    sections: tuple[Section, ...]

    @property
    def concerns(self) -> list[tuple[Section, Concern]]:
        """What is to be done, each with its section: problems first, and causes before the rules that they break."""
        every = [(section, concern) for section in self.sections for concern in section.concerns]
        return sorted(every, key=lambda pair: (not pair[1].is_problem, _CONSEQUENCES.get(pair[0].name, 0)))

    @property
    def num_problems(self) -> int:
        """Concerns that must be settled before more is collected."""
        return sum(concern.is_problem for _, concern in self.concerns)

    @property
    def exit_code(self) -> int:
        """4 where the validator failed, 1 where there is a problem; what was not examined changes nothing."""
        if self.pilot.report.verdict == "error":
            return EXIT_FAILED
        return EXIT_INVALID if self.num_problems else EXIT_SUCCESS

    def to_json(self) -> dict[str, Any]:
        """The report as `schemas/v0.1/pilot.schema.json` has it."""
        facts = self.pilot.report.dataset
        return {
            "spec_version": SPEC_VERSION,
            "validator_version": self.pilot.report.validator_version,
            "exit_code": self.exit_code,
            "dataset": {
                "path": facts.path,
                "dataset_id": facts.dataset_id,
                "dataset_version": facts.dataset_version,
                "content_identity": facts.content_identity,
                "num_groups": facts.num_groups,
                "num_rollouts": facts.num_rollouts,
            },
            "groups_wanted": self.pilot.num_wanted,
            "num_problems": self.num_problems,
            "sections": [section.to_json() for section in self.sections],
        }


def examine_pilot(pilot: Pilot, reruns: Reruns | None, *, num_kills: int) -> PilotReport:
    """Examine a pilot.

    Args:
        pilot: What was read of it.
        reruns: The command that collected it, ``None`` where none is given.
        num_kills: Kills of the crash drill, at least 1.
    """
    causes = [physics(pilot), action_response(pilot), columns(pilot)]
    runs = [determinism(pilot, reruns), crash_drill(pilot, reruns, num_kills=num_kills)]
    replays = replay_noise(pilot, is_early=timing_of(pilot).is_early)
    forecasts = [leakage_power(pilot), funnel_forecast(pilot), route_plan(pilot), cost(pilot, reruns)]
    return PilotReport(pilot, (conformance(pilot, [*causes, replays]), *causes, *runs, replays, *forecasts))
