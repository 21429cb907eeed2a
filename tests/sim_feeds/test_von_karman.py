"""Von Karman turbulence: the filters against their spectra, the series against the filters."""

import numpy as np
import pytest

from sim_feeds.gusts import discrete_noise
from sim_feeds.von_karman import (
    LATERAL,
    LONGITUDINAL,
    VonKarman,
    exact_density,
    rotation_of_the_air,
)
from sim_feeds.wind import Route, Wind

X = np.geomspace(0.01, 3000.0, 200)
"""omega L / V; for a scale of 300 m, waves of 190 km to 0.6 m."""


@pytest.mark.parametrize("shaping", [LONGITUDINAL, LATERAL], ids=["u", "v and w"])
def test_filters_have_the_von_karman_spectrum(shaping):
    """The tail falls with -5/3, which the usual low-order filters do not hold."""
    ratio = shaping.density(X) / exact_density(X, lateral=shaping is LATERAL)
    assert np.abs(ratio - 1.0).max() < 0.02
    x = np.linspace(0.0, 20_000.0, 1_000_001)
    assert np.trapezoid(shaping.density(x), x) == pytest.approx(1.0, abs=0.01)


def test_the_exact_spectra_are_mil_f_8785c():
    """Unit variance, and at zero frequency 2 / pi and 1 / pi; in the tail v has 4/3 of u."""
    x = np.concatenate([np.linspace(0.0, 10.0, 20_001), np.geomspace(10.0, 1e7, 20_001)[1:]])
    for lateral, first in ((False, 2.0 / np.pi), (True, 1.0 / np.pi)):
        density = exact_density(x, lateral=lateral)
        assert density[0] == pytest.approx(first)
        assert np.trapezoid(density, x) == pytest.approx(1.0, abs=1e-3)
    tail = np.array([1e5])
    ratio = exact_density(tail, lateral=True) / exact_density(tail, lateral=False)
    np.testing.assert_allclose(ratio, 4.0 / 3.0, rtol=1e-4)


@pytest.mark.parametrize("shaping", [LONGITUDINAL, LATERAL], ids=["u", "v and w"])
def test_series_has_the_density_of_its_filter(shaping):
    """Averaged periodogram; 200 segments leave 7 % of scatter, octaves of them less."""
    age, n, segments = 0.05, 2048, 200
    y = shaping.series(n * segments, age, np.random.default_rng(5)).reshape(segments, n)
    window = np.hanning(n)
    power = np.abs(np.fft.rfft(window * y, axis=1)) ** 2
    density = power.mean(axis=0) * age / (np.pi * np.sum(window**2))
    x = 2.0 * np.pi * np.fft.rfftfreq(n, age)
    for low in (0.5, 1.0, 2.0, 5.0, 10.0):
        band = (x > low) & (x < 2.0 * low)
        # Folding of what lies above half the sampling rate.
        fold = sum(
            shaping.density(k * 2.0 * np.pi / age + s * x[band])
            for k in range(1, 30)
            for s in (-1, 1)
        )
        ratio = density[band] / (shaping.density(x[band]) + fold)
        assert ratio.mean() == pytest.approx(1.0, abs=0.06)


def test_series_is_stationary_from_its_first_sample():
    rng = np.random.default_rng(7)
    y = np.array([LATERAL.series(40, 0.1, rng) for _ in range(1200)])
    np.testing.assert_allclose(y.std(axis=0), 1.0, rtol=0.08)


def test_a_step_is_two_half_steps():
    A, B, _ = LATERAL.system()
    W = np.outer(B, B)
    half, kick, _ = discrete_noise(A, W, 0.1)
    whole, both, start = discrete_noise(A, W, 0.2)
    np.testing.assert_allclose(half @ half, whole, atol=1e-10)
    np.testing.assert_allclose(
        half @ kick @ kick.T @ half.T + kick @ kick.T, both @ both.T, atol=1e-10
    )
    P = start @ start.T
    np.testing.assert_allclose(whole @ P @ whole.T + both @ both.T, P, atol=1e-10)


def test_intensity_and_scale_follow_height_and_wind():
    model = VonKarman(wind_6m_m_s=6.0, high_std_m_s=1.5)
    std, scale = model.scales(np.array([1000.0, 3000.0]) * 0.3048)
    np.testing.assert_allclose(std[0], 0.6, rtol=1e-12)
    np.testing.assert_allclose(scale[0], 304.8, rtol=1e-12)
    np.testing.assert_allclose(std[1], 1.5)
    np.testing.assert_allclose(scale[1], 762.0)


def test_turbulence_is_laid_along_the_path():
    t = np.arange(0.0, 60.0, 0.05)
    one = np.ones_like(t)
    model = VonKarman(wind_6m_m_s=6.0)
    rng = np.random.default_rng
    north = model.velocity(Route(t, 200.0 * one, 25.0 * one, 0.0 * one), rng(3))
    east = model.velocity(Route(t, 200.0 * one, 25.0 * one, np.pi / 2.0 * one), rng(3))
    np.testing.assert_allclose(east, north[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-12)
    assert Wind([model]).velocity(Route.still(t, 25.0), rng(1)).shape == (len(t), 3)


def test_faster_flight_meets_the_same_air_sooner():
    """The process lives in space: at twice the speed the correlation time is half."""
    t = np.arange(0.0, 2500.0, 0.1)
    model = VonKarman(wind_6m_m_s=6.0)

    def correlation(tas: float, lag_s: float) -> float:
        u = model.along_path(Route.still(t, tas, 200.0), np.random.default_rng(2))[:, 0]
        k = round(lag_s / 0.1)
        return float(np.corrcoef(u[k:], u[:-k])[0, 1])

    assert correlation(20.0, 4.0) == pytest.approx(correlation(40.0, 2.0), abs=0.06)
    speeding = np.linspace(20.0, 30.0, len(t))
    u = model.along_path(
        Route(t, np.full_like(t, 200.0), speeding, 0.0 * t), np.random.default_rng(2)
    )
    np.testing.assert_allclose(u.std(axis=0), [0.685, 0.685, 0.6], rtol=0.12)


def test_air_that_turns_like_a_body():
    """w = -q x and v = r x, met at 25 m/s: the rates come back once the lag is over."""
    V, dt, q, r = 25.0, 0.005, 0.02, -0.03
    x = V * np.arange(0.0, 4.0, dt)
    air = rotation_of_the_air(r * x, -q * x, tas_m_s=V, span_m=2.9, dt_s=dt)
    np.testing.assert_allclose(air.q[-1], q, rtol=1e-6)
    np.testing.assert_allclose(air.r[-1], r, rtol=1e-6)
    assert not air.p.any()


def test_rotation_of_the_air_has_its_transfer_function():
    V, dt, b, omega = 25.0, 0.001, 2.9, 8.0
    t = np.arange(0.0, 20.0, dt)
    gust = np.sin(omega * t)
    air = rotation_of_the_air(gust, gust, tas_m_s=V, span_m=b, dt_s=dt)
    tail = t > 20.0 - 4.0 * 2.0 * np.pi / omega
    carrier = np.exp(1j * omega * t[tail])
    basis = np.column_stack([carrier.real, carrier.imag])
    for series, length, sign in ((air.q, 4.0 * b / np.pi, -1.0), (air.r, 3.0 * b / np.pi, 1.0)):
        a, c = np.linalg.lstsq(basis, series[tail], rcond=None)[0]
        # sin = Im(carrier): the response Im(H carrier) has cosine Im H and sine Re H.
        H = sign * (1j * omega / V) / (1.0 + 1j * omega * length / V)
        np.testing.assert_allclose([a, c], [H.imag, H.real], rtol=2e-3)
