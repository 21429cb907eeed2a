"""ArduPilot's airspeed health and EKF3's wind, held to the figures of its sources."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.baselines import ardupilot
from estimators.baselines.ardupilot import ArduPilotAirspeed
from estimators.baselines.autopilot_events import (
    PARAMETER,
    begin_along_heading,
    fuse_airspeed,
    fuse_sideslip,
    new_wind,
)
from tests.estimators.autopilot_flights import SPEED_M_S, off_by, straight

WIND_MAX_ONLY = {"ARSPD_WIND_MAX": 15.0, "ARSPD_OPTIONS": 3.0}
FIVE_HZ_US = 150_000
"""Time between looks, on a loop of 10 Hz, that makes five looks a second [us]."""


def said(out: np.ndarray, what: float, pitot: int = 0) -> list[float]:
    """Times [s] of one kind of event on a pitot."""
    return [row[0] * 1e-6 for row in out if row[2] == what and row[1] == pitot]


def test_health_falls_below_a_tenth_in_4_4_s_and_recovers_in_29_s_at_five_looks_a_second() -> None:
    check = ArduPilotAirspeed(WIND_MAX_ONLY, every_us=FIVE_HZ_US)
    out = check.step(*straight(100.0, off_by(20.0, 20.0, 40.0)))
    (disabled,) = said(out, ardupilot.DISABLED)
    (enabled,) = said(out, ardupilot.ENABLED)
    assert disabled - 20.0 == pytest.approx(4.4, abs=0.2)
    assert enabled - 40.0 == pytest.approx(29.0, abs=0.8)


def test_a_loop_of_ten_hertz_looks_every_300_ms() -> None:
    out = ArduPilotAirspeed(WIND_MAX_ONLY).step(*straight(140.0, off_by(20.0, 20.0, 60.0)))
    assert said(out, ardupilot.DISABLED)[0] - 20.0 == pytest.approx(22 * 0.3, abs=0.3)
    assert said(out, ardupilot.ENABLED)[0] - 60.0 == pytest.approx(148 * 0.3, abs=0.6)


@pytest.mark.parametrize(
    "parameters",
    [
        {"ARSPD_WIND_MAX": 0.0, "ARSPD_OPTIONS": 3.0},
        {"ARSPD_WIND_MAX": 15.0, "ARSPD_OPTIONS": 0.0},
        {"ARSPD_WIND_MAX": 25.0, "ARSPD_OPTIONS": 3.0},
    ],
)
def test_nothing_is_disabled_where_the_parameters_say_so(parameters: dict[str, float]) -> None:
    out = ArduPilotAirspeed(parameters).step(*straight(60.0, off_by(20.0, 20.0)))
    assert said(out, ardupilot.DISABLED) == []


def test_a_parameter_in_the_stream_takes_effect() -> None:
    t, kind, value = straight(60.0, off_by(20.0, 20.0))
    place = ardupilot.PARAMETERS["ARSPD_WIND_MAX"][0]
    at = int(np.searchsorted(t, 30_000_000))
    t, kind = np.insert(t, at, 30_000_000), np.insert(kind, at, PARAMETER)
    value = np.insert(value, at, [place, 10.0, 0.0, 0.0], axis=0)
    out = ArduPilotAirspeed({"ARSPD_OPTIONS": 3.0}).step(t, kind, value)
    assert said(out, ardupilot.DISABLED)[0] == pytest.approx(36.6, abs=0.4)


def test_a_pitot_that_reads_exactly_zero_is_not_judged() -> None:
    t, kind, value = straight(60.0, off_by(0.0, 20.0))
    value[kind == 0, 0] = 0.0
    assert len(ArduPilotAirspeed(WIND_MAX_ONLY).step(t, kind, value)) == 0


def test_the_innovation_of_the_primary_disables_a_healthy_neighbour() -> None:
    out = ArduPilotAirspeed().step(*straight(60.0, off_by(15.0, 20.0), pitots=2))
    first = [said(out, ardupilot.DISABLED, k) for k in (0, 1)]
    assert first[0] == first[1] != []


def test_a_disabled_pitot_comes_back_when_the_fix_is_lost() -> None:
    events = straight(60.0, off_by(20.0, 20.0), fix=lambda t: 3.0 if t < 40.0 else 1.0)
    out = ArduPilotAirspeed(WIND_MAX_ONLY).step(*events)
    assert said(out, ardupilot.FELL_BACK)[0] == pytest.approx(40.1, abs=0.4)


@pytest.mark.parametrize(("error", "seen"), [(5.5, False), (6.5, True)])
def test_what_passes_four_sigma_becomes_wind_and_what_does_not_times_out(
    error: float, seen: bool
) -> None:
    check = ArduPilotAirspeed()
    out = check.step(*straight(160.0, off_by(error, 40.0)))
    wind_north = check.state[ardupilot.WIND][0]
    if seen:
        assert said(out, ardupilot.TIMED_OUT)[0] == pytest.approx(45.1, abs=0.2)
        assert abs(wind_north) < 0.2
    else:
        assert said(out, ardupilot.TIMED_OUT) == []
        assert said(out, ardupilot.DISABLED) == []
        assert wind_north == pytest.approx(-error, abs=0.6)


def test_a_ramp_of_ten_percent_a_minute_is_never_seen_on_a_straight() -> None:
    ramp = straight(900.0, lambda t: SPEED_M_S * (1.0 + np.clip((t - 30.0) / 600.0, 0.0, 2.0)))
    check = ArduPilotAirspeed()
    assert len(check.step(*ramp)) == 0
    assert check.state[ardupilot.WIND][0] < -25.0


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, 2400), max_size=4))
def test_any_split_of_the_stream_says_the_same(cuts: list[int]) -> None:
    events = straight(60.0, off_by(20.0, 20.0, 30.0))
    whole = ArduPilotAirspeed(WIND_MAX_ONLY).step(*events)
    check = ArduPilotAirspeed(WIND_MAX_ONLY)
    edges = [0, *sorted(cuts), len(events[0])]
    parts = [check.step(*(e[a:b] for e in events)) for a, b in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_wind_filter_against_dense_matrices() -> None:
    f = new_wind()
    V, q = np.array([15.0, 8.0, 1.0]), np.array([np.cos(0.3), 0.02, 0.01, np.sin(0.3)])
    q /= np.linalg.norm(q)
    begin_along_heading(f, V, 20.0, 0.6, 2.0, 30.0)
    x = f[:2].copy()
    P = np.array([[f[2], f[3]], [f[3], f[4]]])
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    np.testing.assert_allclose(P, turn @ np.diag([2.0, 30.0]) @ turn.T)

    def update(
        h: np.ndarray, nu: float, R: float, R_V: float
    ) -> tuple[float, np.ndarray, np.ndarray]:
        S = h @ P @ h + R_V * h @ h + R
        K = P @ h / S
        return S, x + K * nu, P - np.outer(K, h @ P)

    n = np.linalg.norm(V - np.append(x, 0.0))
    S, x, P = update(-(V[:2] - x) / n, 21.0 - n, 2.0, 0.1)
    nu, S_kernel, passed = fuse_airspeed(f, V, 21.0, 2.0, 0.1, 4.0, True)
    assert (passed, S_kernel, nu) == (True, pytest.approx(S), pytest.approx(21.0 - n))
    np.testing.assert_allclose(f[:5], [*x, P[0, 0], P[0, 1], P[1, 1]])

    def beta(w: np.ndarray) -> float:
        a, b, c, d = q
        R = np.array(
            [
                [1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)],
                [2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)],
                [2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)],
            ]
        )
        body = R.T @ (V - np.append(w, 0.0))
        return float(body[1] / body[0])

    step = 1e-6
    h = np.array([(beta(x + step * e) - beta(x - step * e)) / (2 * step) for e in np.eye(2)])
    S, x, P = update(h, -beta(x), 0.03, 0.1)
    fuse_sideslip(f, V, q, 0.03, 0.1, 10.0, 0.5)
    np.testing.assert_allclose(f[:5], [*x, P[0, 0], P[0, 1], P[1, 1]], rtol=1e-6)
