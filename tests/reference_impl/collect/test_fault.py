"""Faults have names and rates; whatever else is given is refused in one clear line."""

from __future__ import annotations

import re

import pytest
from tests.each import each

from branchdrive.contract.columns import PATTERNS
from branchdrive.errors import UsageError
from branchdrive_reference.collect.fault import ATTEMPT_FAULTS, DESCRIPTIONS, FAILURES, FAULT_RATES, Fault
from branchdrive_reference.collect.plan import FAULT_PRESETS, PRESETS
from branchdrive_reference.rendering.fault import ImageFault


def test_every_fault_is_described_and_may_stand_in_a_descriptor() -> None:
    assert list(DESCRIPTIONS) == list(Fault)
    assert all(re.fullmatch(PATTERNS["id"], name) for name in Fault)
    assert ATTEMPT_FAULTS[: len(FAILURES)] == FAILURES


@pytest.mark.parametrize(
    ("text", "rates"),
    [
        ("none", {}),
        ("partial=0.25", {"partial": 0.25}),
        (" partial = 1e-1 , late_branch=1 ", {"partial": 0.1, "late_branch": 1.0}),
        ("partial=0,dropped_frame=0.5", {"dropped_frame": 0.5}),
        ("paper", dict(PRESETS["paper"].faults)),
        ("benchmark", dict(PRESETS["benchmark"].faults)),
    ],
)
def test_rates_are_read(text: str, rates: dict[str, float]) -> None:
    assert FAULT_RATES.parse(text, FAULT_PRESETS) == rates


@each(
    ("text", "problem"),
    [
        ("", "'' is no fault"),
        ("demo", "'demo' is no fault"),
        ("lost=0.1", "'lost' is no fault"),
        ("partial=0.1,", "'' is no fault"),
        ("partial", "'' is no rate of 'partial'"),
        ("partial=much", "'much' is no rate of 'partial'"),
        ("partial=1.5", "the rate 1.5 of 'partial' is not in 0 .. 1"),
        ("partial=-0.1", "the rate -0.1 of 'partial' is not in 0 .. 1"),
        ("partial=nan", "the rate nan of 'partial' is not in 0 .. 1"),
        ("partial=0.1,partial=0.2", "'partial' comes twice"),
    ],
)
def test_other_texts_are_refused_with_the_names_that_are_known(text: str, problem: str) -> None:
    with pytest.raises(UsageError) as caught:
        FAULT_RATES.parse(text, FAULT_PRESETS)
    message = str(caught.value)
    assert message.startswith(
        f"--faults {text!r}: {problem}; give one of none, benchmark, context, deep, paper, or NAME=RATE"
    )
    assert message.endswith(", ".join([*Fault, *ImageFault]))
    assert "\n" not in message
