"""The atmosphere against the printed tables of ISO 2533 and textbook airspeeds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import atmosphere as air

# ISO 2533 table 5: altitude m, temperature K, pressure Pa, density kg/m^3
ISO_2533 = [
    (0.0, 288.150, 101325.0, 1.22500),
    (1000.0, 281.650, 89874.6, 1.11164),
    (5000.0, 255.650, 54019.9, 0.736116),
    (11000.0, 216.650, 22632.1, 0.363918),
    (15000.0, 216.650, 12044.6, 0.193674),
]


@pytest.mark.parametrize(("altitude", "temperature", "pressure", "density"), ISO_2533)
def test_the_standard_atmosphere_is_the_table(
    altitude: float, temperature: float, pressure: float, density: float
) -> None:
    assert air.temperature(altitude) == pytest.approx(temperature, abs=1e-9)
    assert air.pressure(altitude) == pytest.approx(pressure, rel=5e-6)
    assert air.density(pressure, temperature) == pytest.approx(density, rel=5e-6)
    assert air.altitude_from_pressure(pressure) == pytest.approx(altitude, abs=0.05)
    assert air.sigma_rho(altitude) == pytest.approx(math.sqrt(density / 1.225), rel=5e-6)
    assert air.sigma_rho_from_pressure(pressure) == pytest.approx(air.sigma_rho(altitude), rel=5e-6)


def test_mach_078_at_fl350_worked_by_hand() -> None:
    # a = 38.968 kt sqrt(T) = 576.4 kt; q_c/p = 1.12168^3.5 - 1 = 0.49466; delta = 0.23530
    kt = 1852 / 3600
    altitude = 35000 * 0.3048
    p, T = air.pressure(altitude), air.temperature(altitude)
    assert air.tas_from_cas(264.42 * kt, p, T) / kt == pytest.approx(449.6, abs=0.1)
    assert air.eas_from_cas(264.42 * kt, p) / kt == pytest.approx(250.28, abs=0.05)
    assert air.cas_from_tas(449.6 * kt, p, T) / kt == pytest.approx(264.42, abs=0.05)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.5, 200.0), st.floats(-1000.0, 12000.0))
def test_the_airspeeds_invert_each_other(cas: float, altitude: float) -> None:
    p, T = air.pressure(altitude), air.temperature(altitude)
    tas = air.tas_from_cas(cas, p, T)
    assert air.cas_from_tas(tas, p, T) == pytest.approx(cas, rel=1e-12)
    assert air.cas_from_impact_pressure(air.impact_pressure_from_cas(cas)) == pytest.approx(
        cas, rel=1e-12
    )
    assert air.eas_from_cas(cas, p) == pytest.approx(air.sigma_rho(altitude) * tas, rel=1e-12)


def test_at_sea_level_all_three_airspeeds_are_one() -> None:
    assert air.tas_from_cas(60.0, air.P0_PA, 288.15) == pytest.approx(60.0, rel=1e-12)
    assert air.eas_from_cas(60.0, air.P0_PA) == pytest.approx(60.0, rel=1e-12)


def test_the_incompressible_reading_is_high_by_the_mach_term() -> None:
    for cas in (20.0, 50.0, 100.0):
        indicated = math.sqrt(2 * air.impact_pressure_from_cas(cas) / air.RHO0_KG_M3)
        mach = cas / air.SOUND0_M_S
        assert indicated / cas - 1 == pytest.approx(mach**2 / 8, rel=0.02)
        assert air.cas_from_indicated(indicated) == pytest.approx(cas, rel=1e-12)


@pytest.mark.parametrize("impact", [0.0, -3.0, math.nan])
def test_no_impact_pressure_no_airspeed(impact: float) -> None:
    assert air.cas_from_impact_pressure(impact) == 0.0


def test_gravity_is_the_shared_table(oracle) -> None:  # type: ignore[no-untyped-def]
    with np.load(oracle / "kinematic_models.npz") as data:
        ours = [air.gravity(lat, h) for lat, h in data["env"]]
        assert np.allclose(ours, data["g"], rtol=0, atol=1e-12)
