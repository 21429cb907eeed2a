"""Latching: what is confirmed, what is not, and when a sensor comes back."""

from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.detection import Latch, LatchRule, LatchState, significant

SECOND = 1_000_000
RULE = LatchRule(confirm_us=SECOND, clear_us=5 * SECOND, grace_us=SECOND // 2)


@pytest.mark.parametrize(
    ("z", "f", "expected"),
    [(7.0, 1.0, True), (-7.0, -1.0, True), (7.0, 0.1, False), (3.0, 9.0, False), (nan, 9.0, False)],
)
def test_a_fault_needs_both_significance_and_size(z: float, f: float, expected: bool) -> None:
    assert significant(z, f, threshold=5.0, size=0.5) is expected


def play(latch: Latch, alarms: str) -> list[LatchState]:
    """One step every 0.25 s: '#' alarm, '.' agreement, '-' neither."""
    return [latch.step(i * SECOND // 4, c == "#", c == ".") for i, c in enumerate(alarms)]


def test_called_once_the_alarm_held_for_the_confirmation_time() -> None:
    states = play(Latch(RULE), "..#####")
    assert states.index(LatchState.FAULTY) == 6
    assert states[2:6] == [LatchState.SUSPECT] * 4


def test_a_short_break_does_not_restart_the_confirmation_but_a_long_one_does() -> None:
    assert play(Latch(RULE), "##-##")[-1] is LatchState.FAULTY
    assert play(Latch(RULE), "##---##")[-1] is LatchState.SUSPECT


def test_onset_is_when_the_alarm_began() -> None:
    latch = Latch(RULE)
    play(latch, "...#####")
    assert latch.since_us == 3 * SECOND // 4


def test_a_fault_that_hovers_is_one_fault() -> None:
    states = play(Latch(RULE), "#####" + "....#" * 40)
    assert set(states[4:]) == {LatchState.FAULTY}


def test_cleared_after_unbroken_agreement_only() -> None:
    latch = Latch(RULE)
    states = play(latch, "#####" + "." * 21)
    assert states[-2] is LatchState.FAULTY
    assert states[-1] is LatchState.OK
    assert latch.since_us is None


@given(st.text("#.-", max_size=200))
def test_never_faulty_without_an_alarm_held_for_the_confirmation_time(alarms: str) -> None:
    for i, state in enumerate(play(Latch(RULE), alarms)):
        if state is LatchState.FAULTY:
            assert alarms[: i + 1].count("#") >= 2
            return
