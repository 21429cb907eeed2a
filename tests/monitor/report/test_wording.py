"""How the report writes moments, durations, numbers and groups."""

import pytest

from monitor.pages.html import clock
from monitor.report.wording import count, grouped, lasting, listed, moments, number


@pytest.mark.parametrize(
    ("t_s", "digits", "text"),
    [
        (0.0, 0, "0:00"),
        (139.6, 0, "2:20"),
        (139.64, 1, "2:19.6"),
        (59.97, 1, "1:00.0"),
        (3599.9, 0, "1:00:00"),
        (36_061.0, 0, "10:01:01"),
        (-1.2, 1, "-0:01.2"),
        (-0.004, 0, "0:00"),
    ],
)
def test_moments_read_as_on_the_axes(t_s: float, digits: int, text: str) -> None:
    assert clock(t_s, digits) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.03, "30 ms"),
        (0.0, "0.0 s"),
        (9.94, "9.9 s"),
        (9.96, "10 s"),
        (59.7, "1 min 00 s"),
        (252.0, "4 min 12 s"),
        (3720.0, "1 h 02 min"),
    ],
)
def test_durations_carry_their_unit(seconds: float, text: str) -> None:
    assert lasting(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.5123, "1.51"),
        (-0.0123, "-0.0123"),
        (24_312.6, "24,313"),
        (40.0, "40"),
        (0.0, "0"),
        (float("nan"), "–"),
        (2.5e-7, "2.50e-07"),
    ],
)
def test_numbers_have_three_digits_and_no_more(value: float, text: str) -> None:
    assert number(value) == text


def test_many_spans_are_summed_up() -> None:
    spans = [(10.0 * i, 10.0 * i + 1.0 + i) for i in range(5)]
    assert moments(spans[:2]) == "0:00 to 0:01, 0:10 to 0:12"
    assert moments(spans) == "5 times between 0:00 and 0:45, 5.0 s at the longest"


def test_axes_of_an_imu_stand_together() -> None:
    axes = [f"imu0.{kind}_{axis}" for kind in ("acc", "gyro") for axis in "xyz"]
    assert grouped(axes) == "imu0 (all six axes)"
    assert grouped(["imu1.gyro_z", "airspeed0", "imu1.acc_x"]) == "airspeed0; imu1 acc x, gyro z"
    wings = [f"wing_{side}.{part}" for side in ("left", "right") for part in ("lift", "drag")]
    assert grouped(wings) == "both wings, lift and drag"
    assert grouped(wings[:1]) == "wing_left.lift"


def test_counts_and_lists() -> None:
    assert count(1, "gap") == "1 gap"
    assert count(1234, "gap") == "1,234 gaps"
    assert listed(["a", "b", "c"]) == "a, b and c"
