"""Effects of interventions, against analytic cases."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from branchdrive.driving.response import BEFORE_BRANCH, NO_RESPONSE, Responses, first_response, lateral_effect_m


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, math.pi / 2, -2.5, math.pi])
def test_lateral_effect_is_the_offset_across_the_nominal_heading(yaw_rad: float) -> None:
    ahead_m, left_m = 7.0, 2.5
    x = 3.0 + ahead_m * math.cos(yaw_rad) - left_m * math.sin(yaw_rad)
    y = -4.0 + ahead_m * math.sin(yaw_rad) + left_m * math.cos(yaw_rad)
    found = lateral_effect_m(*(np.array([value]) for value in (x, y, 3.0, -4.0, yaw_rad)))
    assert found == pytest.approx([left_m])


def test_first_response_is_counted_from_the_branch() -> None:
    differs = np.zeros((4, 3 + 11), bool)
    differs[1, 3:] = True  # at t_b
    differs[2, 5:] = True  # at t_b + 10
    differs[3, 2:] = True  # before the branch
    assert first_response(differs, 3).tolist() == [NO_RESPONSE, 0, 2, BEFORE_BRANCH]


def interventions(num: int, **columns: object) -> Responses:
    """Interventions of one group and policy on a moving nominal, that do nothing but what is said."""
    none = Responses.none()
    values = {field.name: getattr(none, field.name) for field in fields(Responses)}
    still = {name: np.zeros((num, *value.shape[1:]), value.dtype) for name, value in values.items()}
    said = {name: np.array(value, still[name].dtype) for name, value in columns.items()}
    return replace(Responses(**still), **{"moves": np.ones(num, bool), **said})


def responses(steer: list[float], drive: list[float], lateral_m: list[float], speed_mps: list[float]) -> Responses:
    return interventions(len(steer), steer=steer, drive=drive, lateral_m=lateral_m, speed_mps=speed_mps)


def test_agreement_counts_one_command_at_a_time_and_no_small_effect() -> None:
    right = responses([0.1, 0.1, -0.1, 0.1, 0.1, 0.03], [0, 0, 0, 0.5, 0, 0], [-1, 1, 1, -1, -0.05, -1], [0] * 6)
    assert right.steering.tolist() == [1, -1, 1, 0, 0, 0]
    faster = responses([0, 0, 0, 0.2], [0.5, -0.5, 0.5, 0.5], [0] * 4, [2, -2, -2, 2])
    assert faster.driving.tolist() == [1, 1, -1, 0]


def test_policies_are_compared_in_the_groups_that_have_both() -> None:
    every = interventions(
        6, group=[1, 2, 3, 1, 2, 4], policy=[5, 5, 5, 6, 6, 6], steer=[0.1, 0.1, 0.1, 0.2, 0.12, 0.2],
        first=[1, 1, 1, 1, NO_RESPONSE, 1], future=[7, 8, 9, 7, 8, 9],
    )  # fmt: skip
    differs, is_one = every.others(5, 6)
    assert differs.tolist() == [True, False]
    assert is_one.tolist() == [True, True]


def test_only_steering_and_braking_must_have_an_effect() -> None:
    every = interventions(
        4, group=[1, 2, 3, 4], policy=[1, 2, 3, 4], steer=[0.05, 0.0, 0.0, 0.0], drive=[0.0, -0.3, 0.5, -0.1],
        future=[7] * 4, nominal_future=[7] * 4,
    )  # fmt: skip
    assert every.copies(nominal=0) == [(1, frozenset({0, 1})), (2, frozenset({0, 2}))]


def test_responses_of_shards_add_up() -> None:
    one, two = responses([0.1], [0.0], [-1.0], [0.0]), responses([0.2, 0.3], [0.0, 0.0], [-2.0, -3.0], [0.0, 0.0])
    every = Responses.of_all([one, Responses.none(), two])
    assert every.steer.tolist() == [0.1, 0.2, 0.3]
    assert len(Responses.of_all([]).policy) == 0


def test_policies_are_in_order_where_one_command_and_its_response_differ() -> None:
    every = interventions(
        8, group=[1, 2, 3, 4] * 2, policy=[5] * 4 + [6] * 4, steer=[0.0] * 4 + [-0.1, -0.1, -0.1, -0.03],
        turn_rad=[0.0] * 4 + [0.1, -0.1, 0.005, 0.1],
    )  # fmt: skip
    turns, drives = every.orders(6, 5)
    assert turns.tolist() == every.orders(5, 6)[0].tolist() == [1, -1, 0, 0]
    assert drives.tolist() == [0, 0, 0, 0]
    braked = interventions(
        6, group=[1, 2, 3] * 2, policy=[5] * 3 + [6] * 3, drive=[-0.5] * 3 + [-1.0] * 3,
        accel_mps2=[[0, -4]] * 3 + [[0, -8], [0, -1], [0, -5.5]], moves=[True, True, True] * 2,
    )  # fmt: skip
    assert braked.orders(6, 5)[1].tolist() == [1, -1, 0]
    standing = replace(braked, moves=np.zeros(6, bool))
    assert standing.orders(6, 5)[1].tolist() == [0, 0, 0]
    assert [values.tolist() for values in Responses.none().orders(6, 5)] == [[], []]
    assert [values.tolist() for values in every.orders(6, 99)] == [[], []]


def told(began_mps: list[float], drive: list[float], is_one: list[bool]) -> tuple[int, int]:
    """What is denied of two policies in groups, of which the first gains 3 m/s and the second drives less."""
    num = len(began_mps)
    future = [*range(num), *(k if same else -1 for k, same in enumerate(is_one))]
    accel = [[0.0, 0.0 if same else 1.0] for same in is_one]
    every = interventions(
        2 * num, group=[*range(num)] * 2, policy=[0] * num + [1] * num, drive=[*drive, *[0.0] * num],
        first=[1] * 2 * num, accel_mps2=accel + [[0.0, 0.0]] * num, began_mps=began_mps * 2, gain_mps=[3.0] * 2 * num,
        future=future,
    )  # fmt: skip
    return every.denied(0, 1)


def test_a_future_of_two_is_denied_where_others_tell_them_apart() -> None:
    at = [5.0, 6.0, 7.0]
    assert told([*at, 6.5], [0.3] * 4, [True, True, True, False]) == (2, 1)  # none is as fast as the third
    assert told([*at, 8.1, 4.9], [0.3] * 5, [True, True, True, False, False]) == (3, 2)
    assert told([*at, 11.0], [0.3] * 4, [True, True, True, False]) == (0, 1)  # tyres may slip up to there
    assert told([*at, 7.5], [0.3, 0.3, 0.3, 0.31], [True, True, True, False]) == (0, 1)  # of more throttle
    assert told(at, [0.3] * 3, [True] * 3) == (0, 0)
    assert told([*at, 7.5], [0.03] * 4, [True, True, True, False]) == (0, 0)
