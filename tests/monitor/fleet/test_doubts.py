"""What speaks against a fault, one reason at a time."""

from __future__ import annotations

from typing import Any

import pytest

from monitor.fleet.doubts import WHY, Doubt, autopilot_agrees, doubts
from tests.monitor.fleet.small_fleet import fault, span, summary


def found(one: dict[str, Any], *others: dict[str, Any], **more: Any) -> list[Doubt]:
    return doubts(one, summary([one, *others], **more))


def watched(sensor: str, *spans: dict[str, Any]) -> dict[str, Any]:
    return {"monitored": [{"sensor": sensor, "seconds": 999.0, "unmonitored": list(spans)}]}


def test_nothing_speaks_against_a_fault_that_stays_in_mid_flight() -> None:
    assert found(fault()) == []


@pytest.mark.parametrize(("after_s", "expected"), [(19.0, [Doubt.SOON_OVER]), (21.0, [])])
def test_a_fault_that_mends_itself_soon(after_s: float, expected: list[Doubt]) -> None:
    assert found(fault(isolated_s=603.0, cleared_s=603.0 + after_s)) == expected


@pytest.mark.parametrize(("named_s", "expected"), [(69.0, [Doubt.AT_FIRST]), (71.0, [])])
def test_a_fault_that_is_named_right_after_take_off(named_s: float, expected: list[Doubt]) -> None:
    assert found(fault(onset_s=named_s - 1.0, isolated_s=named_s)) == expected


def test_the_take_off_of_another_sensor_says_nothing() -> None:
    ground = watched("airspeed1", span(0.0, 60.0, "on ground"))
    assert found(fault(onset_s=62.0), **ground) == []


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        (("imu0.acc_x", "imu0.acc_y"), []),
        (("imu0.acc_x", "imu1.acc_x"), [Doubt.MANY_AT_ONCE]),
    ],
)
def test_three_instruments_at_once_are_one_cause(
    others: tuple[str, ...], expected: list[Doubt]
) -> None:
    assert found(fault(), *(fault(sensor, 602.0) for sensor in others)) == expected
    assert found(fault(), *(fault(sensor, 640.0) for sensor in others)) == []


@pytest.mark.parametrize(
    ("sensor", "from_s", "expected"),
    [
        ("gps0", 605.0, [Doubt.REFERENCE_LOST]),
        ("airspeed0", 580.0, [Doubt.REFERENCE_LOST]),
        ("gps0", 700.0, []),
        ("imu0.acc_x", 605.0, []),
    ],
)
def test_a_reference_that_was_lost_near_it(
    sensor: str, from_s: float, expected: list[Doubt]
) -> None:
    assert found(fault(), **watched(sensor, span(from_s, from_s + 15.0, "stale"))) == expected


@pytest.mark.parametrize(
    ("said", "agrees"),
    [
        ({"sensor": "airspeed0", "from_s": 620.0}, True),
        ({"sensor": "airspeed1", "from_s": 620.0}, False),
        ({"sensor": "airspeed0", "from_s": 500.0}, False),
        ({"sensor": "airspeed0", "from_s": 900.0}, False),
    ],
)
def test_the_autopilot_agrees_when_it_blames_the_same_instrument_meanwhile(
    said: dict[str, Any], agrees: bool
) -> None:
    one = fault(cleared_s=650.0)
    baselines = {"ardupilot": [], "px4": [said]}
    assert autopilot_agrees(one, summary([one], baselines=baselines)) is agrees


def test_every_doubt_is_explained() -> None:
    assert list(WHY) == list(Doubt)
