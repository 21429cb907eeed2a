"""Faults: shape, onset, end; the physics of blocked tubes; the papers' tables."""

import numpy as np
import pytest

from links.vocabulary import Kind
from sim_feeds import earth
from sim_feeds.faults import (
    DRAWN,
    KNOT_M_S,
    PLUMBING,
    Fault,
    FaultKind,
    apply_all,
    draw_wan2018,
    lu2016_table2,
    plumbing,
)

T = np.arange(0.0, 40.0, 0.1)
X = 50.0 + np.sin(T)
ON, OFF = 10.0, 30.0
BEFORE = 50.0 + np.sin(9.9)
AGE = T - ON

SHAPES = {
    FaultKind.BIAS: ({"size": 2.0}, X + 2.0),
    FaultKind.DRIFT: ({"rate": 0.5}, X + 0.5 * AGE),
    FaultKind.RUNAWAY: ({"rate": -5.0, "limit": 20.0}, X + np.maximum(-5.0 * AGE, -20.0)),
    FaultKind.OSCILLATION: ({"size": 3.0, "period_s": 4.0}, X + 3.0 * np.sin(np.pi / 2 * AGE)),
    FaultKind.STUCK: ({}, np.full_like(X, BEFORE)),
    FaultKind.JAMMING: ({"size": 7.0}, np.full_like(X, 7.0)),
    FaultKind.NRZ: ({"size": 0.1}, X + 0.1 * BEFORE),
    FaultKind.SCALE: ({"size": -0.2}, 0.8 * X),
    FaultKind.ICING: ({"rate": 0.06}, X * np.maximum(1.0 - 0.06 * AGE, 0.1)),
    FaultKind.DROPOUT: ({}, np.full_like(X, np.nan)),
    FaultKind.DEAD: ({}, np.zeros_like(X)),
}


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("kind", SHAPES)
def test_shape_between_onset_and_end_and_nothing_outside(kind):
    values, expected = SHAPES[kind]
    y = Fault("airspeed0", kind, ON, OFF, **values).apply(T, X, rng())
    on = (T >= ON) & (T < OFF)
    np.testing.assert_allclose(y[on], expected[on], rtol=1e-12)
    np.testing.assert_array_equal(y[~on], X[~on])


def test_noise_has_its_size_and_stays_inside():
    t = np.arange(0.0, 400.0, 0.1)
    x = np.zeros_like(t)
    y = Fault("aoa0", FaultKind.NOISE, 100.0, 300.0, size=2.0).apply(t, x, rng())
    on = (t >= 100.0) & (t < 300.0)
    assert y[on].std() == pytest.approx(2.0, rel=0.06)
    assert not y[~on].any()


def test_every_kind_is_covered_and_has_a_word_in_the_vocabulary():
    apart = {FaultKind.OUTAGE, FaultKind.STOP}
    assert set(SHAPES) | DRAWN | apart | PLUMBING == set(FaultKind)
    assert all(isinstance(kind.seen_as, Kind) for kind in FaultKind)


def test_a_fault_without_end_stays():
    y = Fault("aoa0", FaultKind.BIAS, ON, size=1.0).apply(T, X, rng())
    assert y[-1] == X[-1] + 1.0


def test_faults_of_one_channel_add_up_and_draw_independently():
    noise = Fault("aoa0", FaultKind.NOISE, ON, size=1.0)
    bias = Fault("aoa0", FaultKind.BIAS, ON, size=5.0)
    both = apply_all([noise, bias], T, X, rng())
    alone = apply_all([noise], T, X, rng())
    np.testing.assert_allclose(both[T >= ON] - alone[T >= ON], 5.0)


def air(height: np.ndarray, tas: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    static = earth.static_pressure(height)
    return earth.impact_pressure(tas, static, earth.temperature(height)), static


HEIGHT = 100.0 + np.clip(2.0 * (T - 15.0), 0.0, 20.0)
IMPACT, STATIC = air(HEIGHT)


def test_blocked_pitot_with_closed_drain_reads_like_an_altimeter():
    fault = Fault("airspeed0", FaultKind.PITOT_BLOCKED, ON)
    difference, static = plumbing([fault], T, IMPACT, STATIC)
    on = T >= ON
    np.testing.assert_array_equal(static, STATIC)
    first = np.argmax(on)
    np.testing.assert_allclose(difference[on], STATIC[first] + IMPACT[first] - STATIC[on])
    # 20 m up is 237 Pa less outside: on top of the 245 Pa of 20 m/s it reads as 28 m/s.
    cas = earth.calibrated_airspeed(difference)
    assert cas[(T > 11.0) & (T < 14.9)] == pytest.approx(cas[first], abs=1e-6)
    assert cas[-1] == pytest.approx(27.9, abs=0.2)


def test_blocked_pitot_with_open_drain_falls_to_zero():
    fault = Fault("airspeed0", FaultKind.PITOT_DRAINING, ON, OFF, drain_s=1.5)
    difference, _ = plumbing([fault], T, IMPACT, STATIC)
    at = int(np.searchsorted(T, ON + 1.5 - 1e-9))
    assert difference[at] == pytest.approx(IMPACT[at] * np.exp(-1.0), rel=1e-3)
    assert np.abs(difference[(T > 20.0) & (T < 29.9)]).max() < 0.5
    np.testing.assert_allclose(difference[T >= OFF], IMPACT[T >= OFF], rtol=1e-12)


def test_blocked_static_port_reads_low_above_and_freezes_the_altimeter():
    fault = Fault("airspeed0", FaultKind.STATIC_BLOCKED, ON)
    difference, static = plumbing([fault], T, IMPACT, STATIC)
    on = T >= ON
    assert np.ptp(static[on]) == 0.0
    np.testing.assert_allclose(difference[on] - IMPACT[on], STATIC[on] - static[on], atol=1e-9)
    assert difference[-1] < 0.1 * IMPACT[-1], "20 m above the onset nearly all of 20 m/s is gone"
    down_impact, down_static = air(200.0 - HEIGHT)
    difference, _ = plumbing([fault], T, down_impact, down_static)
    assert difference[-1] > 1.9 * down_impact[-1]


def test_lu2016_table2():
    """The printed formulas between 10 and 30 s, the six channels in order."""
    t = np.arange(0.0, 40.0, 0.01)
    faults = lu2016_table2()
    assert [f.sensor.split(".")[1] for f in faults] == [
        "acc_x",
        "acc_y",
        "acc_z",
        "gyro_x",
        "gyro_y",
        "gyro_z",
    ]
    degree = np.pi / 180.0
    printed = [
        3.0 + 0.0 * t,
        0.1 * (t - 10.0),
        4.0 * np.sin(0.5 * np.pi * t),
        1.5 * degree + 0.0 * t,
        degree * np.sin(0.5 * np.pi * (t - 10.0)),
        3.0 * degree + 0.0 * t,
    ]
    on = (t >= 10.0) & (t < 30.0)
    for fault, formula in zip(faults, printed, strict=True):
        y = fault.apply(t, np.zeros_like(t), rng())
        np.testing.assert_allclose(y[on], formula[on], atol=1e-12)
        assert not y[~on].any()


@pytest.mark.parametrize("sensor", ["aoa1", "airspeed2"])
def test_wan2018_draws_stay_in_table_ii(sensor):
    draw = np.random.default_rng(1)
    unit = np.pi / 180.0 if sensor == "aoa1" else KNOT_M_S
    sizes = (0.5, 25.0) if sensor == "aoa1" else (10.0, 200.0)
    rates = (0.2, 25.0) if sensor == "aoa1" else (0.5, 50.0)
    hertz = (0.5, 1.0) if sensor == "aoa1" else (0.5, 4.0)
    faults = [draw_wan2018(draw, sensor, 5.0) for _ in range(300)]
    assert len({f.kind for f in faults}) == 6
    for f in faults:
        size = abs(f.size) / unit
        match f.kind:
            case FaultKind.OSCILLATION:
                assert sizes[0] <= size <= sizes[1]
                assert hertz[0] <= 1.0 / f.period_s <= hertz[1] + 1e-9
            case FaultKind.RUNAWAY:
                assert rates[0] <= abs(f.rate) / unit <= rates[1]
            case FaultKind.NRZ:
                assert abs(f.size) == 0.1
            case FaultKind.NOISE:
                assert (1 <= size <= 2) if sensor == "aoa1" else (10 <= size <= 20)
            case _:
                assert sizes[0] <= size <= sizes[1]
    if sensor == "airspeed2":
        assert all(f.size > 0 for f in faults if f.kind is FaultKind.JAMMING)
