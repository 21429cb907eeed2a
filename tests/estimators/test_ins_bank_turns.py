"""Increments of the attitude against a gyro: a rate is told from a step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from estimators.attitude import quaternion_from_rotation_vector, quaternion_product
from estimators.ins_bank_turns import TURNS, forget_turns, note_turn, undo_jump, usual_error

Array = NDArray[np.float64]

RATE = np.array([0.3, -0.1, 0.2])
DT = 0.2


def turned(bias: Array, jump_at: int = -1, count: int = 20) -> Array:
    """A steady turn that a gyro with this bias saw, and an attitude that may jump by 30 deg."""
    turns = np.full((TURNS, 11), np.nan)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for i in range(count):
        note_turn(turns, i * DT, q, (RATE + bias) * (i * DT))
        q = quaternion_product(q, quaternion_from_rotation_vector(RATE * DT))
        if i == jump_at:
            q = quaternion_product(
                quaternion_from_rotation_vector(np.array([0.0, 0.0, math.radians(30.0)])), q
            )
    return turns


def test_the_bias_of_the_gyro_is_what_the_attitude_does_not_turn() -> None:
    bias = np.array([0.0, 0.04, -0.02])
    np.testing.assert_allclose(usual_error(turned(bias), 0.0), bias, atol=1e-9)


def test_a_jump_of_the_attitude_is_no_rate() -> None:
    turns = turned(np.zeros(3), jump_at=10)
    mean = np.nanmean(turns[:, 1:4], axis=0)
    assert np.abs(mean).max() > 0.05
    np.testing.assert_allclose(usual_error(turns, 0.0), 0.0, atol=1e-9)


def test_increments_before_the_onset_do_not_count() -> None:
    turns = turned(np.zeros(3))
    turns[turns[:, 0] < 2.0, 1:4] = 1.0
    np.testing.assert_allclose(usual_error(turns, 2.0), 0.0, atol=1e-9)


@pytest.mark.parametrize("since_s", [3.2, 5.0])
def test_few_increments_say_nothing(since_s: float) -> None:
    assert usual_error(turned(np.full(3, 0.1)), since_s).tolist() == [0.0, 0.0, 0.0]


def test_a_hole_in_the_samples_is_not_bridged() -> None:
    turns = turned(np.full(3, 0.1))
    forget_turns(turns)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    note_turn(turns, 4.0, q, np.zeros(3))
    note_turn(turns, 5.0, q, np.ones(3))
    assert np.isnan(turns[:, 1:4]).all()


def undone(bias: Array, jump_deg: float, *, alone: bool) -> float:
    """Heading [deg] undone over a turn in which the attitude's heading jumps by some angle."""
    turns, heading = np.full((TURNS, 11), np.nan), np.array([0.0, -1e9])
    for i in range(20):
        angle = RATE[2] * i * DT + math.radians(jump_deg if i >= 10 else 0.0)
        q = quaternion_from_rotation_vector(np.array([0.0, 0.0, angle]))
        note_turn(turns, i * DT, q, (np.array([0.0, 0.0, RATE[2]]) + bias) * (i * DT))
        undo_jump(turns, heading, alone)
    return math.degrees(heading[0])


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("jump_deg", [5.0, -30.0, 170.0])
def test_a_jump_of_the_heading_is_undone(jump_deg: float, alone: bool) -> None:
    assert undone(np.zeros(3), jump_deg, alone=alone) == pytest.approx(-jump_deg, abs=1e-6)


def test_a_rate_is_undone_where_the_attitude_can_only_follow_the_gyro() -> None:
    fast, slow = np.array([0.0, 0.0, 0.2]), np.array([0.0, 0.0, 0.1])
    assert undone(fast, 0.0, alone=False) == 0.0
    assert undone(slow, 0.0, alone=True) == 0.0
    assert undone(fast, 0.0, alone=True) == pytest.approx(math.degrees(0.2 * 19 * DT), abs=1e-6)
