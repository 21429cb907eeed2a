"""Wind components: values of the shaped ones, statistics of the turbulence."""

import numpy as np
import pytest

from sim_feeds.wind import Constant, Dryden, Gust, HeightShear, Ramp, Route, Wind, toward

RATE_HZ = 20.0


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def turbulence(
    model: Dryden, tas: float, seconds: float = 6000.0, agl: float = 1500.0, seed: int = 1
):
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    return model.velocity(Route.still(t, tas, agl), rng(seed))


def test_direction_is_where_the_air_goes():
    np.testing.assert_allclose(toward(5.0, 0.0), [5.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(toward(5.0, 90.0, -1.0), [0.0, 5.0, -1.0], atol=1e-15)


def test_shaped_components():
    route = Route.still(np.array([0.0, 4.0, 5.0, 6.0, 20.0]), 20.0, 75.0)
    ramp = Ramp(4.0, 6.0, toward(3.0, 0.0)).velocity(route, rng())
    np.testing.assert_allclose(ramp[:, 0], [0.0, 0.0, 1.5, 3.0, 3.0])
    gust = Gust(4.0, 1.0, 1.0, toward(6.0, 90.0)).velocity(route, rng())
    np.testing.assert_allclose(gust[:, 1], [0.0, 0.0, 6.0, 6.0, 0.0], atol=1e-12)
    shear = HeightShear(toward(8.0, 0.0), 300.0, 0.5).velocity(route, rng())
    np.testing.assert_allclose(shear[:, 0], 4.0)


def test_components_add_and_draw_independently():
    """Taking one component away leaves the turbulence of the other bit for bit."""
    route = Route.still(np.arange(0.0, 20.0, 0.05), 50.0)
    constant = Constant(toward(5.0, 45.0))
    both = Wind([Dryden(), constant]).velocity(route, rng())
    alone = Wind([Dryden()]).velocity(route, rng())
    np.testing.assert_allclose(both - alone, np.tile(constant.ned_m_s, (400, 1)), atol=1e-12)
    assert Wind().velocity(route, rng()).any() == 0.0


def test_dryden_variance():
    """lu2016: 3.54 m/s and 530 m; 6000 s hold about 1000 correlation times."""
    w = turbulence(Dryden(fixed_std_m_s=3.54, fixed_scale_m=530.0), 100.0)
    np.testing.assert_allclose(w.std(axis=0), 3.54, rtol=0.07)
    assert np.abs(w.mean(axis=0)).max() < 0.5
    assert np.abs(np.corrcoef(w.T) - np.eye(3)).max() < 0.1


@pytest.mark.parametrize("lag_s", [1.0, 2.5, 5.0])
def test_dryden_correlation(lag_s):
    """Longitudinal exp(-x), lateral and vertical exp(-x) (1 - x / 2), with x = V lag / L."""
    tas, scale = 100.0, 530.0
    w = turbulence(Dryden(fixed_std_m_s=1.0, fixed_scale_m=scale), tas, seed=2)
    k, x = round(lag_s * RATE_HZ), lag_s * tas / scale
    found = [np.corrcoef(w[:-k, i], w[k:, i])[0, 1] for i in range(3)]
    expected = [np.exp(-x), np.exp(-x) * (1 - x / 2), np.exp(-x) * (1 - x / 2)]
    np.testing.assert_allclose(found, expected, atol=0.06)


def test_dryden_does_not_depend_on_the_grid():
    """Increments over 0.2 s have the same size on a fine and on a coarse grid."""
    model = Dryden(fixed_std_m_s=1.0, fixed_scale_m=200.0)
    size = []
    for hz in (10.0, 100.0):
        t = np.arange(0.0, 2000.0, 1.0 / hz)
        w = model.velocity(Route.still(t, 50.0), rng(3))
        size.append((w[round(0.2 * hz) :] - w[: -round(0.2 * hz)]).std(axis=0))
    np.testing.assert_allclose(size[0], size[1], rtol=0.06)


def test_military_scales():
    """MIL-F-8785C: the low-altitude formulas, 1750 ft above 2000 ft, linear in between."""
    foot = 0.3048
    model = Dryden(wind_6m_m_s=10.0, high_std_m_s=2.0)
    std, scale = model.scales(np.array([100.0, 1000.0, 1500.0, 3000.0]) * foot)
    factor = 0.177 + 0.0823
    np.testing.assert_allclose(std[0], [1 / factor**0.4, 1 / factor**0.4, 1.0])
    np.testing.assert_allclose(scale[0] / foot, [100 / factor**1.2, 100 / factor**1.2, 100])
    np.testing.assert_allclose(scale[1] / foot, 1000.0, rtol=1e-6)
    np.testing.assert_allclose(scale[2] / foot, 1375.0, rtol=1e-6)
    np.testing.assert_allclose(std[3], 2.0)
    np.testing.assert_allclose(scale[3] / foot, 1750.0)


def test_along_and_across_turn_with_the_heading():
    """Flying east, the longitudinal component is the east one."""
    t = np.arange(0.0, 30.0, 0.05)
    one = np.ones_like(t)
    model = Dryden()
    north = model.velocity(Route(t, 900 * one, 50 * one, 0 * one), rng(4))
    east = model.velocity(Route(t, 900 * one, 50 * one, np.pi / 2 * one), rng(4))
    np.testing.assert_allclose(east[:, 1], north[:, 0], atol=1e-12)
    np.testing.assert_allclose(east[:, 0], -north[:, 1], atol=1e-12)
