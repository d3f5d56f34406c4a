"""Action response of every policy of a pilot, and what it says of commands and of the clock of observations."""

from __future__ import annotations

import numpy as np

from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.contract.timing import ACTIVE_TICKS, OBSERVATION_STRIDE_TICKS, TICK_S
from branchdrive.engine.response_summary import ActionResponse, Effect, ResponseSummary
from branchdrive.engine.response_table import response_table
from branchdrive.pilot.onset import onsets
from branchdrive.pilot.pilot import Pilot
from branchdrive.pilot.section import Concern, Section
from branchdrive.raw.rules.responses import MIN_EQUAL, MIN_INTERVENTIONS

__all__ = ["action_response"]

_TITLE = "Action response"

_STRIDE_S = OBSERVATION_STRIDE_TICKS * TICK_S

_CLOCK = ("BD-RSP-003", "BD-RSP-004")
"""Rules on the clock of observations, which replays with noise give no subject."""

_LATE, _EARLY = 0.9, -0.5
"""Onsets, in observations, of observations that are a stride late or early; actuators lag by less than 0.2 s."""

_LAGS = 0.5 / OBSERVATION_STRIDE_TICKS
"""Onset of half a tick: observations that are a tick late show from here, and so do actuators that lag."""

_SPEAKING = {
    "BD-RSP-002": (
        "The commands of {keys} are ignored: {found}.",
        "Apply the policy's command to the vehicle itself at every active tick, after the expert's and any autopilot "
        "that would overwrite it, and record what was applied.",
    ),
    "BD-RSP-003": (
        "Observations are one stride early, or commands act before their tick: {found}.",
        "Take the observation of tick t before the control of tick t is applied.",
    ),
    "BD-RSP-004": (
        "Observations are late: {found}.",
        "Write the observation of tick t with the state at tick t, before the control of t is applied: one that was "
        "taken earlier and written later shows every response late.",
    ),
}
"""What it means that a rule on responses fails, in words of a collector, and what to do."""


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
    begins = onsets(pilot.parts)
    onset = float(np.median(begins)) if len(begins) >= MIN_INTERVENTIONS else None
    concerns = [*_failed(pilot), *_ignored(pilot, summary), *_unshown(summary)]
    if onset is not None and not _has_failed(pilot):
        concerns += _wrong_onset(onset, len(begins))
    missing = sorted(set(pilot.descriptor.action_bank.keys) - {action.action_key for action in summary.actions})
    nominal = pilot.descriptor.action_bank.nominal.key
    unseen = [f"{key}: no attempt with whole windows" for key in missing if key != nominal]
    return Section(
        "response", _TITLE, [*_facts(summary), _onset_fact(onset, len(begins))], concerns, [response_table(summary)],
        [*unseen, *_unjudged(pilot, has_onset=onset is not None)],
        {"actions": summary.to_json()["actions"], "onset_s": None if onset is None else onset * _STRIDE_S},
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
    else:
        facts.append("No replay equals its nominal up to the branch, so noise hides the first response.")
    return facts


def _has_failed(pilot: Pilot) -> bool:
    return any(tally.rule_id in _CLOCK and tally.num_findings for tally in pilot.report.tallies)


def _failed(pilot: Pilot) -> list[Concern]:
    concerns = []
    for tally in pilot.report.tallies:
        if tally.rule_id in _SPEAKING and tally.findings:
            what, remedy = _SPEAKING[tally.rule_id]
            keys = ", ".join(str(finding.location.get("action_key")) for finding in tally.findings)
            concerns.append(Concern(what.format(keys=keys, found=tally.findings[0].found), remedy))
    return concerns


def _ignored(pilot: Pilot, summary: ResponseSummary) -> list[Concern]:
    """Concern of commands that never have an effect, in fewer groups than BD-RSP-002 takes to judge a policy."""
    if any(tally.rule_id == "BD-RSP-002" and tally.status in ("pass", "fail") for tally in pilot.report.tallies):
        return []
    total = sum(action.num_groups for action in summary.actions)
    if total < MIN_EQUAL or not all(map(_is_silent, summary.actions)):
        return []
    what, remedy = _SPEAKING["BD-RSP-002"]
    keys = ", ".join(action.action_key for action in summary.actions)
    found = f"the nominal's observations, bit for bit, in {total} of {total} attempts"
    return [Concern(what.format(keys=keys, found=found), remedy)]


def _onset_fact(onset: float | None, num_effects: int) -> str:
    if onset is None:
        return f"{counted(num_effects, 'effect')} rise straight and clear of noise, too few to say when effects begin."
    return f"Extrapolated, effects begin {onset * _STRIDE_S:+.2f} s from the branch (median of {num_effects})."


def _wrong_onset(onset: float, num_effects: int) -> list[Concern]:
    """Concern of effects that begin an observation too late or too early."""
    begin = f"effects begin {onset * _STRIDE_S:+.2f} s from the branch in the median of {num_effects} interventions"
    if onset >= _LATE:
        what, remedy = _SPEAKING["BD-RSP-004"]
        return [Concern(what.format(found=begin), f"{remedy} An actuator that lags as much does the same.")]
    if onset <= _EARLY:
        what, remedy = _SPEAKING["BD-RSP-003"]
        return [Concern(what.format(found=begin), remedy)]
    if onset >= _LAGS:
        ticks = counted(max(1, round(onset * OBSERVATION_STRIDE_TICKS)), "tick")
        return [
            Concern(
                f"Actuators lag, or observations are late by about {ticks}: {begin}.",
                "Nothing, where steering and pedals of the simulator lag by as much. Otherwise write the observation "
                "of tick t with the state at tick t, and apply the command of t in the step from t.",
                is_problem=False,
            )
        ]
    return []


def _unjudged(pilot: Pilot, *, has_onset: bool) -> list[str]:
    """Rules on responses that had no subject; what an onset says as well is not missed."""
    return [
        f"{tally.rule_id} ({CATALOGUE[tally.rule_id].title}): {tally.reason}"
        for tally in pilot.report.tallies
        if tally.rule_id in _SPEAKING
        and tally.status in ("skipped", "error")
        and tally.reason
        and not (has_onset and tally.rule_id in _CLOCK)
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
