"""Action response of every policy of a pilot, and what it says of commands and of the clock of observations."""

from __future__ import annotations

import numpy as np

from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.driving.response import MIN_EFFECT_M, MIN_EFFECT_MPS, Responses
from branchdrive.engine.response_summary import ActionResponse, Effect, ResponseSummary
from branchdrive.engine.response_table import response_table
from branchdrive.engine.tally import Tally
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.pilot.timing import EARLY, LATE, Timing, timing_of
from branchdrive.raw.rules.responses import MIN_EQUAL, MIN_INTERVENTIONS

__all__ = ["action_response"]

_TITLE = "Action response"

_STRIDE_S = OBSERVATION_STRIDE_TICKS * TICK_S

_EFFECT = "BD-RSP-002"

_EXPLAINED = {
    _EFFECT: "are ignored",
    "BD-GRP-009": "are ignored",
    EARLY: "before their commands",
    "BD-RPN-003": "before their commands",
    LATE: "Effects come late",
}
"""Rules that fail for what a concern names, and words of it."""

_OBSERVE_FIRST = (
    "Take the observation of tick t, with its actors, before the command of t is applied and the simulator steps, and "
    "record a command at the tick in which it acts."
)

_NOT_LATER = (
    "write the observation of tick t with the state at tick t, before the command of t is applied, and give the "
    "simulator the command of t in the step from t: one that is taken earlier and written later, or a command that "
    "waits for the next step, makes every effect late."
)


def action_response(pilot: Pilot) -> Section:
    """What each action did against the nominal of its group, and when it shows first."""
    if not pilot.parts:
        return Section("response", _TITLE, not_examined=[pilot.unread])
    summary = pilot.report.response
    if summary is None or not summary.actions:
        return Section(
            "response", _TITLE,
            not_examined=["no group has a nominal and an intervention with whole windows around one branch"],
        )  # fmt: skip
    tallies = {tally.rule_id: tally for tally in pilot.report.tallies}
    timing = timing_of(pilot)
    ignored = _ignored(tallies[_EFFECT], summary, pilot.responses())
    concerns = [
        *ignored, *_shifted(timing),
        *(() if timing.is_early else _anticipated(tallies[EARLY])), *(() if ignored else _unshown(summary)),
    ]  # fmt: skip
    missing = sorted(set(pilot.descriptor.action_bank.keys) - {action.action_key for action in summary.actions})
    nominal = pilot.descriptor.action_bank.nominal.key
    unseen = [f"{key}: no attempt with whole windows" for key in missing if key != nominal]
    return Section(
        "response", _TITLE, [*_facts(summary), *_onset_facts(timing)], concerns, [response_table(summary)],
        [*unseen, *_unjudged(tallies, timing)],
        {
            "actions": summary.to_json()["actions"],
            "onset_s": None if timing.ticks is None else timing.ticks * TICK_S,
            "onsets": {
                name: {
                    "interventions": onset.num,
                    "onset_s": onset.ticks * TICK_S,
                    "interval_s": [onset.low * TICK_S, onset.high * TICK_S],
                }
                for name, onset in timing.onsets.items()
            },
        },
        explains=[rule_id for rule_id, what in _EXPLAINED.items() if any(what in concern.what for concern in concerns)],
    )  # fmt: skip


def _facts(summary: ResponseSummary) -> list[str]:
    first = [action.first_response for action in summary.actions if action.first_response is not None]
    facts = [f"{len(summary.actions)} policies compared {ACTIVE_TICKS * TICK_S:g} s after the branch."]
    if first:
        low, high = min(first) * _STRIDE_S, max(first) * _STRIDE_S
        facts.append(
            f"Responses show first {low:.2f} s after the branch"
            + ("." if low == high else f" at the earliest policy, {high:.2f} s at the latest.")
        )
    elif all(map(_is_silent, summary.actions)):
        facts.append("No response shows.")
    else:
        facts.append("No replay equals its nominal up to the branch, so noise hides the first response.")
    return facts


def _onset_facts(timing: Timing) -> list[str]:
    if not timing.onsets:
        return []
    parts = [
        f"{onset.ticks * TICK_S:+.2f} s from the command with {name} ({onset.low * TICK_S:+.2f} to "
        f"{onset.high * TICK_S:+.2f} s, {onset.num} interventions)"
        for name, onset in timing.onsets.items()
    ]
    fact = f"Effects begin {', '.join(parts)}."
    if timing.is_early or timing.is_late or len(parts) < 2:
        return [fact]
    lagging = [name for name, onset in timing.onsets.items() if onset.low > 0]
    if not lagging:
        return [fact]
    in_time = "" if len(lagging) == len(parts) else "; commands and observations are in time"
    return [fact, f"The vehicle's {' and '.join(lagging)} may lag by as much{in_time}."]


def _shifted(timing: Timing) -> list[Concern]:
    """Concern of effects that come before their commands, or late."""
    if timing.is_early:
        return [
            Concern(
                f"Effects come before their commands{timing.amount}: observations are early, with a state behind "
                f"their tick, or commands act before the tick that they are recorded at; {timing.evidence}.",
                _OBSERVE_FIRST,
            )
        ]
    if timing.is_stride_late:
        return [
            Concern(
                f"Effects come late{timing.amount}, a stride of observations or more: observations are late, with an "
                f"earlier state than that of their tick, or commands act late; {timing.evidence}.",
                f"{_NOT_LATER[0].upper()}{_NOT_LATER[1:]}",
            )
        ]
    if timing.is_late:
        return [
            Concern(
                f"Effects come late{timing.amount}: commands act late, observations are late, with an earlier state "
                f"than that of their tick, or steering and pedals of the vehicle lag; {timing.evidence}.",
                f"Nothing, where steering and pedals of the simulator lag by as much. Otherwise {_NOT_LATER}",
                is_problem=False,
            )
        ]
    return []


def _anticipated(tally: Tally) -> list[Concern]:
    """Concern of accelerations alone that are early."""
    found = [finding for finding in tally.findings if "column" in finding.location]
    return [
        Concern(
            f"{finding.location['column']} shows effects before their commands: {finding.found}.",
            "Record at tick t the acceleration of the step that ended there, (v_t - v_(t-1)) / 0.05 s, not that of the "
            "step which begins.",
        )
        for finding in found
    ]


def _ignored(tally: Tally, summary: ResponseSummary, every: Responses) -> list[Concern]:
    """Concern of commands without an effect, in fewer groups too than BD-RSP-002 takes to judge a policy.

    In replays with noise nothing equals the nominal bit for bit; commands are ignored there if no intervention has an
    effect that is large enough to have a sign.
    """
    if tally.status in ("pass", "fail"):
        keys = [str(finding.location.get("action_key")) for finding in tally.findings]
        found = tally.findings[0].found if keys else ""
    else:
        total = sum(action.num_groups for action in summary.actions)
        is_silent = total >= MIN_EQUAL and all(map(_is_silent, summary.actions))
        keys = [action.action_key for action in summary.actions] if is_silent else []
        found = f"the nominal's observations, bit for bit, in {total} of {total} attempts"
    if not keys:
        num_commanded = int(every.is_commanded.sum())
        has_effect = (np.abs(every.lateral_m) >= MIN_EFFECT_M) | (np.abs(every.speed_mps) >= MIN_EFFECT_MPS)
        if num_commanded < MIN_INTERVENTIONS or (every.is_commanded & has_effect).any():
            return []
        keys = [action.action_key for action in summary.actions]
        found = (
            f"{num_commanded} of {num_commanded} attempts end less than {MIN_EFFECT_M:g} m beside the nominal and less "
            f"than {MIN_EFFECT_MPS:g} m/s from its speed"
        )
    whose = f"all {len(keys)} policies" if len(keys) == len(summary.actions) > 1 else ", ".join(keys)
    return [
        Concern(
            f"The commands of {whose} are ignored: {found}.",
            "Apply the policy's command to the vehicle itself at every active tick, after the expert's and any "
            "autopilot that would overwrite it, and record what was applied.",
        )
    ]


def _unjudged(tallies: dict[str, Tally], timing: Timing) -> list[str]:
    """Rules on responses that had no subject; what an onset says as well is not missed."""
    return [
        f"{rule_id} ({CATALOGUE[rule_id].title}): {tallies[rule_id].reason}"
        for rule_id in (_EFFECT, EARLY, LATE)
        if tallies[rule_id].status in ("skipped", "error")
        and tallies[rule_id].reason
        and not (timing.onsets and rule_id != _EFFECT)
    ]


def _unshown(summary: ResponseSummary) -> list[Concern]:
    """Policies whose effect the groups do not show in either direction."""
    unshown = [
        action.action_key for action in summary.actions
        if not (_is_shown(action.lateral_m) or _is_shown(action.speed_mps)) and not _is_silent(action)
    ]  # fmt: skip
    if not unshown:
        return []
    return [
        Concern(
            f"No mean effect is shown of {', '.join(unshown)}: both 95 % intervals hold 0.",
            "Look at single groups of them: vehicles that stand, or that are held by traffic, do not respond. With "
            "four times the groups the intervals are half as wide.",
            is_problem=False,
        )
    ]


def _is_shown(effect: Effect) -> bool:
    return effect.interval is not None and not effect.interval[0] <= 0 <= effect.interval[1]


def _is_silent(action: ActionResponse) -> bool:
    return action.num_unchanged == action.num_groups
