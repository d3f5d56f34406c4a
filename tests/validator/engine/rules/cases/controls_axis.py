"""Defects and limits of throttle and brake where they are declared as one axis."""

from __future__ import annotations

from tests.validator.engine.rules.case import BRAKE, boundary, mutant
from tests.validator.engine.rules.draft import Draft

# BD-CTL-015

PLACE = {"table": "controls", "rollout_id": BRAKE, "tick": 7}


def _press_both(d: Draft, throttle: float, brake: float) -> None:
    """Both pedals of a tick before the branch."""
    for pedal, command in (("throttle", throttle), ("brake", brake)):
        d.set("controls", (f"expert_{pedal}", f"applied_{pedal}"), command, rollout_id=BRAKE, tick=7)


@mutant("BD-CTL-015", at=PLACE)
def both_parts_of_one_axis(d: Draft) -> None:
    d.descriptor["vehicle"] = {"actuation": "single_axis"}
    _press_both(d, 0.3, 0.125)


@mutant("BD-CTL-015", at=PLACE)
def expert_that_presses_both(d: Draft) -> None:
    d.descriptor["vehicle"] = {"actuation": "single_axis"}
    d.descriptor["tolerances"] = {"actuator": 0.02}
    _press_both(d, 0.3, 0.02)
    d.set("controls", "expert_brake", 0.03, rollout_id=BRAKE, tick=7)


@boundary("BD-CTL-015")
def parts_of_one_axis_within_the_tolerance(d: Draft) -> None:
    d.descriptor["vehicle"] = {"actuation": "single_axis"}
    d.descriptor["tolerances"] = {"actuator": 0.0199}
    _press_both(d, 0.3, 0.0195)


@boundary("BD-CTL-015", status="skipped")
def both_pedals(d: Draft) -> None:
    d.descriptor["vehicle"] = {"actuation": "pedals"}
    _press_both(d, 0.3, 0.125)
