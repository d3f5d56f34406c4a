"""Control rules: what the policy demanded, what reached the vehicle, and who drove.

With ``t_b`` the branch tick and ``T`` the policy's duration, an intervention is active exactly for ``t_b <= t < t_b +
T``. Source: paper, "Intervention Policy Bank" and "Collection Integrity, Replay Fidelity, and Leakage";
spec/04-policies.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.policy import ACTUATORS
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.shard_view import ShardView

Rows = NDArray[np.int64]


def _duration(view: ShardView) -> NDArray[np.int64]:
    """Duration ``T`` of each attempt's policy, ticks; 0 where the bank lacks it."""
    durations = np.array([policy.duration_ticks for policy in view.descriptor.action_bank.policies] + [0])
    return np.asarray(durations[view.policy])


def _at_rows(
    view: ShardView,
    subjects: Mask,
    compared: Mask,
    bad_rows: Mask,
    expected: Callable[[int], str],
    found: Callable[[int], str],
) -> Check:
    """Attempts that are compared, by control rows that violate; described at the first of them."""
    subjects = subjects & compared
    summary = view.controls.by_rollout(bad_rows)

    def describe(i: int) -> Mismatch:
        row = int(summary.first_row[i])
        place: Location = {"table": "controls", "tick": int(view.controls.tick[row])}
        return Mismatch(place, expected(row), found(row), int(summary.count[i]))

    return Check.of_subjects(subjects, subjects & summary.any, describe, summary.stretch)


def _marked(view: ShardView, rows: Rows) -> Mask:
    marked = np.zeros(len(view.controls), bool)
    marked[rows] = True
    return marked


def _with_rows(view: ShardView, rows: Mask) -> Mask:
    """Attempts with one of the control rows ``[rollouts]``."""
    return view.controls.by_rollout(rows).any


@rule("BD-CTL-001")
def nothing_active_before_branch(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """No active tick ``t < t_b``."""
    subjects = subjects & view.role("intervention") & view.branched
    controls = view.controls
    is_early = controls.tick < np.append(view.branch_tick, 0)[controls.rollout]
    yield _at_rows(
        view, subjects, _with_rows(view, is_early), is_early & controls["active"],
        lambda row: f"inactive before branch tick {view.branch_tick[controls.rollout[row]]}", lambda _: "active",
    )  # fmt: skip


@rule("BD-CTL-002")
def window_lasts_its_duration(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """From ``t_b`` on, the active ticks are exactly ``t_b .. t_b + T - 1``."""
    subjects = subjects & view.role("intervention") & view.branched
    rows, controls = view.active_rows, view.controls
    branch, duration = view.branch_tick, _duration(view)
    owner = controls.rollout[rows]
    late = controls.tick[rows] >= branch[owner]
    inside = late & (controls.tick[rows] < (branch + duration)[owner])
    num_late = np.bincount(owner[late], minlength=view.num_rollouts)
    num_inside = np.bincount(owner[inside], minlength=view.num_rollouts)
    bad = (num_late != duration) | (num_inside != duration)

    def describe(i: int) -> Mismatch:
        ticks = controls.tick[rows][(owner == i) & late]
        span = f"{len(ticks)} active ticks" + (f", {ticks.min()} .. {ticks.max()}" if len(ticks) else "")
        window = f"{duration[i]} active ticks, {branch[i]} .. {branch[i] + duration[i] - 1}"
        return Mismatch({"table": "controls", "column": "active"}, window, span)

    yield Check.of_subjects(subjects, subjects & bad, describe)


def _follows_rule(rule_name: str) -> Callable[[ShardView, Mask], Iterator[Check]]:
    def check(view: ShardView, subjects: Mask) -> Iterator[Check]:
        rows, controls = view.active_rows, view.controls
        bank = view.descriptor.action_bank
        policy_of = view.policy[controls.rollout[rows]]
        compared, bad = (np.zeros(len(controls), bool) for _ in range(2))
        demanded = np.zeros((len(ACTUATORS), len(controls)), np.float32)
        wrong_actuator = np.zeros(len(controls), np.int8)
        for policy_index, policy in enumerate(bank.policies):
            for actuator_index, (actuator, demand) in enumerate(zip(ACTUATORS, policy.rules, strict=True)):
                if demand.rule != rule_name or policy.is_nominal:
                    continue
                here = rows[policy_of == policy_index]
                compared[here] = True
                command = demand.evaluate(controls[f"expert_{actuator}"][here], controls[f"nominal_{actuator}"][here])
                wrong = here[controls[f"intended_{actuator}"][here] != command]
                demanded[actuator_index, here] = command
                bad[wrong], wrong_actuator[wrong] = True, actuator_index

        def found(row: int) -> str:
            actuator = ACTUATORS[wrong_actuator[row]]
            return f"intended_{actuator} {quote(controls[f'intended_{actuator}'][row])}"

        def expected(row: int) -> str:
            return f"{ACTUATORS[wrong_actuator[row]]} {quote(demanded[wrong_actuator[row], row])} (`{rule_name}`)"

        yield _at_rows(view, subjects & view.role("intervention"), _with_rows(view, compared), bad, expected, found)

    check.__doc__ = f"Intended commands of `{rule_name}` actuators equal the formula, exactly in float32."
    return check


online_expert_actuators = rule("BD-CTL-003")(_follows_rule("online_expert"))
stored_nominal_actuators = rule("BD-CTL-004")(_follows_rule("stored_nominal"))
zero_actuators = rule("BD-CTL-005")(_follows_rule("zero"))
absolute_actuators = rule("BD-CTL-006")(_follows_rule("absolute"))
floor_actuators = rule("BD-CTL-007")(_follows_rule("floor"))


_APPLIED = {actuator: f"applied_{actuator}" for actuator in ACTUATORS}


def _applied_equals(view: ShardView, subjects: Mask, rows: Mask, demanded: str) -> Check:
    """``|applied - demanded| <= tolerance`` on marked rows, all three actuators; exact by default."""
    controls = view.controls
    tolerance = view.descriptor.tolerances.actuator
    bad = np.zeros(len(controls), bool)
    for actuator in ACTUATORS:
        applied, command = controls[f"applied_{actuator}"], controls[f"{demanded}_{actuator}"]
        bad |= applied != command if tolerance == 0 else np.abs(applied.astype(float) - command) > tolerance

    def text(prefix: str) -> Callable[[int], str]:
        return lambda row: ", ".join(f"{a} {quote(controls[f'{prefix}_{a}'][row])}" for a in ACTUATORS)

    def found(row: int) -> str:
        pairs = {
            name: (float(controls[name][row]), float(controls[f"{demanded}_{actuator}"][row]))
            for actuator, name in _APPLIED.items()
        }
        wrong = [name for name, (applied, command) in pairs.items() if not abs(applied - command) <= tolerance]
        is_turned = all(pairs[name][0] == -pairs[name][1] for name in wrong)
        said = "with the other sign" if is_turned else "differs" if len(wrong) == 1 else "differ"
        return f"{text('applied')(row)}: {' and '.join(wrong)} {said}"

    return _at_rows(view, subjects, _with_rows(view, rows), bad & rows, text(demanded), found)


@rule("BD-CTL-008")
def applied_equals_intended(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """While active, the vehicle gets what the policy demanded."""
    subjects = subjects & view.role("intervention")
    yield _applied_equals(view, subjects, _marked(view, view.active_rows), "intended")


@rule("BD-CTL-009")
def applied_equals_expert(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """While inactive, the vehicle gets what the online expert commanded."""
    yield _applied_equals(view, subjects, ~view.controls["active"], "expert")


@rule("BD-CTL-010")
def stored_nominal_equals_nominal(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``nominal_*`` at an active tick equals ``applied_*`` of the nominal rollout at the same tick."""
    controls = view.controls
    subjects = subjects & view.role("intervention")
    rows = view.active_rows
    source = controls.find(view.nominal[controls.rollout[rows]], controls.tick[rows])
    missing = source < 0
    wrong = missing.copy()
    for actuator in ACTUATORS:
        wrong |= controls[f"nominal_{actuator}"][rows] != controls[f"applied_{actuator}"][source]
    lookup = np.full(len(controls), -1)
    lookup[rows] = source

    def expected(row: int) -> str:
        if lookup[row] < 0:
            return "the nominal rollout's command of this tick, but it has no such tick"
        return ", ".join(f"{a} {quote(controls[f'applied_{a}'][lookup[row]])}" for a in ACTUATORS)

    def found(row: int) -> str:
        return ", ".join(f"{a} {quote(controls[f'nominal_{a}'][row])}" for a in ACTUATORS)

    compared = controls.with_rows(rows)
    yield _at_rows(view, subjects, compared, _marked(view, rows[wrong]), expected, found)


@rule("BD-CTL-011")
def source_follows_active(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``source = intervention`` exactly at active ticks."""
    controls = view.controls
    intervenes = controls.equals("source", "intervention")
    active = controls["active"]

    def word(flag: bool) -> str:
        return "`intervention`" if flag else "`online_expert`"

    yield _at_rows(
        view, subjects, controls.is_there, intervenes != active, lambda row: word(active[row]),
        lambda row: word(intervenes[row]),
    )  # fmt: skip


@rule("BD-CTL-012")
def expert_recovers(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """At ``t_b + T`` there is a control row, inactive and driven by the online expert.

    A policy that recovers otherwise does not qualify: this version cannot record it.
    """
    controls = view.controls
    subjects = subjects & view.role("intervention") & view.branched
    tick = view.branch_tick + _duration(view)
    row = controls.find(np.arange(view.num_rollouts), tick)
    recovers = np.append(~controls["active"] & controls.equals("source", "online_expert"), False)
    recoveries = [policy.recovery for policy in view.descriptor.action_bank.policies] + [""]
    reserved = np.array([recovery != "online_expert" for recovery in recoveries])[view.policy]
    bad = ~recovers[row] | reserved  # where there is no row, -1 is the False at the end

    def describe(i: int) -> Mismatch:
        if reserved[i]:
            found = f"a policy with the recovery {quote(recoveries[view.policy[i]])}"
            return Mismatch({"table": "controls", "tick": int(tick[i])}, "the online expert drives", found)
        found = "no control row" if row[i] < 0 else f"source {quote(controls['source'][row[i]])}"
        return Mismatch({"table": "controls", "tick": int(tick[i])}, "the online expert drives", found)

    yield Check.of_subjects(subjects, subjects & bad, describe)


@rule("BD-CTL-013")
def nominal_runs_untouched(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """A nominal rollout or replay has no active tick."""
    yield _at_rows(
        view,
        subjects & (view.role("nominal") | view.role("nominal_replay")),
        view.controls.is_there,
        _marked(view, view.active_rows),
        lambda _: "inactive",
        lambda _: "active",
    )


@rule("BD-CTL-014")
def effective_action_is_the_policy(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """The ``effective_*`` columns say what the bank's policy says."""
    bank, rollouts = view.descriptor.action_bank, view.rollouts
    differs = np.full(view.num_rollouts, "", dtype=object)
    wanted = [policy.effective_action() for policy in bank.policies]
    for policy, action in enumerate(wanted):
        here = np.flatnonzero(subjects & (view.policy == policy))
        for column, value in action.items():
            valid = rollouts.valid(column)[here]
            differing = valid if value is None else ~valid | (rollouts[column][here] != value)
            differing = differing & (differs[here] == "")
            differs[here[differing]] = column

    def describe(i: int) -> Mismatch:
        column = differs[i]
        found = quote(view.rollouts[column][i]) if view.rollouts.valid(column)[i] else "null"
        return Mismatch({"table": "rollouts", "column": column}, quote(wanted[view.policy[i]][column]), found)

    yield Check.of_subjects(subjects, subjects & (differs != ""), describe)


@rule("BD-CTL-015")
def one_axis_is_never_both(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """``min(throttle, brake) <= tolerance`` of expert and applied commands, where the descriptor declares one axis."""
    vehicle, controls = view.descriptor.vehicle, view.controls
    subjects = subjects & (vehicle is not None and vehicle.actuation == "single_axis")
    both = np.zeros(len(controls), bool)
    for kind in ("expert", "applied"):
        both |= (
            np.minimum(controls[f"{kind}_throttle"], controls[f"{kind}_brake"]) > view.descriptor.tolerances.actuator
        )

    def found(row: int) -> str:
        commands = (f"{kind}_{pedal}" for kind in ("expert", "applied") for pedal in ("throttle", "brake"))
        return ", ".join(f"{command} {quote(controls[command][row])}" for command in commands)

    expected = "throttle or brake, which are one axis of this vehicle"
    yield _at_rows(view, subjects, controls.is_there, both, lambda _: expected, found)
