"""What a report says of interventions: means, intervals, constant columns, and what `strict` makes of diagnostics."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from tests.mutation import MUTANTS, new_draft
from tests.synthetic import BRANCH_TICK
from tests.validator.engine.rules.case import BRAKE, judged_folder
from tests.validator.engine.rules.cases.replays import declare, repeat_exactly

from branchdrive.cli.text import render_report
from branchdrive.engine.response_summary import Effect, ResponseSummary
from branchdrive.files.shard_facts import ShardFacts


def test_interval_is_the_normal_one() -> None:
    values = np.array([1.0, 2.5, -0.5, 4.0, 3.0])
    effect = Effect.of(values)
    wanted = stats.norm.interval(0.95, values.mean(), stats.sem(values))
    assert effect.mean == pytest.approx(values.mean())
    assert effect.interval == pytest.approx(wanted)
    assert Effect.of(values[:1]) == Effect(1.0, None)


def test_constant_columns_are_those_of_all_shards() -> None:
    shards = [
        ShardFacts("a", extremes={"x_m": (0.0, 2.0), "limit": (8.0, 8.0), "other": (1.0, 1.0)}),
        ShardFacts("b", extremes={"x_m": (1.0, 1.0), "limit": (8.0, 8.0), "other": (2.0, 2.0)}),
    ]
    summary = ResponseSummary.of(shards, ())
    assert summary.constant == {"limit": 8.0}
    assert ResponseSummary.of([], ()).to_json() == {"actions": [], "constant": {}}


def test_actions_are_compared_with_the_nominal_of_their_group(tmp_path: Path) -> None:
    report = judged_folder(new_draft("bare").write(tmp_path / "dataset"))
    assert report.response is not None
    effects = {action.action_key: action for action in report.response.actions}
    assert len(effects) == 12
    assert {action.num_groups for action in effects.values()} == {3}
    assert effects["steer_left_0.15"].lateral_m.mean > 0.1 > -0.1 > effects["steer_right_0.15"].lateral_m.mean
    assert effects["accelerate_0.80"].speed_mps.mean > 0.1 > -0.1 > effects["brake_1.00"].speed_mps.mean
    assert report.response.constant == {"speed_limit_mps": 13.5}
    text = render_report(report, io.StringIO())
    assert "Action response" in text
    assert "The same in every observation: speed_limit_mps 13.5" in text


@pytest.mark.parametrize("is_other", [False, True])
def test_reports_say_where_declared_noise_moves_no_intervention(tmp_path: Path, is_other: bool) -> None:
    """Nominal replays differ, as they should where noise is natural, and interventions do not before the branch."""
    draft = new_draft()
    repeat_exactly(draft, *(f"g{group}.nominal_replay.a{attempt}" for group in range(3) for attempt in (1, 2)))
    declare(draft, "natural")
    if is_other:
        draft.set(
            "observations", "x_m", lambda v: float(np.nextafter(v, np.inf)), rollout_id=BRAKE, tick=BRANCH_TICK - 5
        )
    lines = [line for line in judged_folder(draft.write(tmp_path / "dataset")).conditions if "replay noise" in line]
    alike = ", though all 36 interventions have the poses and speeds of their nominal, to the bit, before the branch"
    assert lines == [f"replay noise declared as natural{'' if is_other else alike}"]


def test_strict_refuses_what_diagnostics_found(tmp_path: Path) -> None:
    (late,) = (mutant for mutant in MUTANTS if mutant.rule == "BD-RSP-004")
    draft = new_draft(late.base)
    late.edit(draft)
    root = draft.write(tmp_path / "late")
    assert judged_folder(root).exit_code == 0
    strict = judged_folder(root, strict=True)
    assert (strict.verdict, strict.exit_code) == ("valid", 1)
    assert [tally.rule_id for tally in strict.noted] == ["BD-RSP-004"]
    assert "--strict refuses what these diagnostics and recommendations found: BD-RSP-004" in render_report(
        strict, io.StringIO()
    )
    assert judged_folder(new_draft("bare").write(tmp_path / "good"), strict=True).exit_code == 0


def test_late_responses_are_named_beside_motion_that_does_not_fit(tmp_path: Path) -> None:
    draft, late = new_draft("bare"), next(mutant for mutant in MUTANTS if mutant.rule == "BD-RSP-004")
    late.edit(draft)
    draft.set("rollouts", "result_num_static_collisions", 0)
    draft.set("observations", "speed_mps", lambda speed: 8 * speed)
    report = judged_folder(draft.write(tmp_path / "late"))
    texts = {finding.rule: finding.found for finding in report.findings}
    assert "responses are late, too (BD-RSP-004)" in texts["BD-RSP-006"]
    assert "most of" not in texts["BD-RSP-004"] and "none yet in " in texts["BD-RSP-004"]


def test_steering_to_the_other_side_may_be_the_sign_of_the_column(tmp_path: Path) -> None:
    draft, exchanged = new_draft("bare"), next(mutant for mutant in MUTANTS if mutant.rule == "BD-GRP-010")
    exchanged.edit(draft)
    report = judged_folder(draft.write(tmp_path / "exchanged"))
    (finding,) = (finding for finding in report.findings if finding.rule == "BD-GRP-010")
    assert "recorded applied_steer points to the" in finding.expected
    assert finding.found.endswith("; the sign of steering or the world may be mirrored")


@pytest.mark.parametrize("value", [1e308, float("inf"), float("nan")])
def test_hostile_numbers_are_no_response(value: float, tmp_path: Path) -> None:
    """What a structure rule refuses enters no mean and no constant: a report is JSON whatever cells hold."""
    draft = new_draft("bare")
    draft.set("observations", "x_m", lambda old: value if old > 0 else -value)
    draft.set("observations", "accel_lateral_mps2", value)
    report = judged_folder(draft.write(tmp_path / "dataset"))
    assert report.verdict == "invalid"
    json.dumps(report.to_json(), allow_nan=False)
    assert report.response is not None
    assert report.response.actions == ()
