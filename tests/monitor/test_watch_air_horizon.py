"""The long horizon on synthetic circuits: slow faults are found, slow winds accuse nobody."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from links.vocabulary import Kind, State
from monitor.recording import Estimates
from monitor.settings.air import AirSettings
from monitor.verdict import Verdict
from monitor.watch.air_bank import AirBankWatch

from .air_flights import Flight, circuits, during, judged, said, scaled

ONSET_S = 150.0


def flown(seconds: float, gust: float = 0.5, **keys: Any) -> Flight:
    """Circuits of an aircraft whose nose follows the gusts."""
    return circuits(seconds, gust=gust, weathercock=True, **keys)


def drifting(flight: Flight, percent_min: float, sensors: tuple[str, ...]) -> Flight:
    """The flight with pitots whose reading changes by so much a minute from 150 s on."""
    for sensor in sensors:
        rows = flight[sensor] = flight[sensor].copy()
        since = np.clip(rows["t_us"] * 1e-6 - ONSET_S, 0.0, None)
        rows["cas_m_s"] *= 1.0 + percent_min / 6000.0 * since
    return flight


def faulty(verdicts: list[Verdict]) -> dict[str, Verdict]:
    """First verdict of faulty per sensor."""
    out: dict[str, Verdict] = {}
    for v in verdicts:
        if v.state is State.FAULTY:
            out.setdefault(v.sensor, v)
    return out


def found(flight: Flight) -> dict[str, Verdict]:
    return faulty(judged(flight, AirBankWatch(AirSettings())))


@pytest.mark.parametrize(
    ("percent_min", "within_s"), [(-6.0, 150.0), (10.0, 120.0), (3.0, 290.0), (-2.0, 420.0)]
)
def test_a_single_pitot_that_drifts(percent_min: float, within_s: float) -> None:
    flight = drifting(flown(600.0, pitots=1), percent_min, ("airspeed0",))
    v = found(flight)["airspeed0"]
    assert 0.0 < v.t_us * 1e-6 - ONSET_S < within_s
    assert v.kind is Kind.DRIFT
    if abs(percent_min) < 5.0:  # faster ones are as soon the filter bank's
        assert v.estimator == "air_horizon"
        assert "airspeed0 has drifted to" in v.evidence
    assert np.sign(v.magnitude) == np.sign(percent_min)
    truth = 17.0 * percent_min / 6000.0 * (v.t_us * 1e-6 - ONSET_S)
    assert v.magnitude == pytest.approx(truth, abs=0.8)
    assert v.onset_t_us is not None
    assert abs(v.onset_t_us * 1e-6 - ONSET_S) < 80.0
    assert v.statistic > v.threshold


def test_one_of_two_that_leaks_slowly_and_the_other_is_not_touched() -> None:
    flight = drifting(flown(450.0), -2.0, ("airspeed1",))
    blamed = found(flight)
    assert set(blamed) == {"airspeed1"}
    assert blamed["airspeed1"].t_us * 1e-6 - ONSET_S < 290.0
    assert "airspeed0 agrees" in blamed["airspeed1"].evidence


def test_two_pitots_that_ice_slowly_are_blamed_together() -> None:
    flight = drifting(flown(400.0), -5.0, ("airspeed0", "airspeed1"))
    blamed = found(flight)
    assert set(blamed) == {"airspeed0", "airspeed1"}
    assert blamed["airspeed0"].t_us == blamed["airspeed1"].t_us
    assert blamed["airspeed0"].t_us * 1e-6 - ONSET_S < 175.0
    assert "so does airspeed1" in blamed["airspeed0"].evidence


def test_the_winds_estimate_goes_back_to_before_the_drift() -> None:
    wind = (4.0, -3.0)
    flight = drifting(flown(330.0, wind=wind, pitots=1), -6.0, ("airspeed0",))
    result = AirBankWatch(AirSettings()).step(flight, 1 << 60)
    v = faulty(result.verdicts)["airspeed0"]
    air = result.estimates["air"]
    after = air["t_us"] > v.t_us
    error = air["wind_ned_m_s"][after, :2] - wind
    assert np.sqrt((error**2).mean()) < 0.8


def winds() -> dict[str, np.ndarray | None]:
    t = np.arange(0.0, 600.0, 0.05)
    slow = np.column_stack((9.0 - 0.01 * t, -4.0 + 0.012 * t))
    turned = np.radians(90.0 * np.clip((t - 250.0) / 60.0, 0.0, 1.0))
    front = 8.0 * np.column_stack((np.cos(turned), np.sin(turned)))
    gusty = np.column_stack((6.0 + 2.0 * np.sin(t / 40.0), 5.0 + 2.0 * np.cos(t / 55.0)))
    return {"slow": slow, "front": front, "gusty": gusty}


@pytest.mark.parametrize("pitots", [1, 2])
@pytest.mark.parametrize("name", ["slow", "front", "gusty"])
def test_a_wind_that_changes_accuses_nobody(name: str, pitots: int) -> None:
    wind = winds()[name]
    for seed in range(2):
        flight = flown(600.0, wind=lambda _: wind, pitots=pitots, gust=0.8, seed=seed)
        assert found(flight) == {}


def test_without_turns_no_drift_is_claimed() -> None:
    flight = flown(500.0, pitots=1)
    straight = flown(500.0, pitots=1, straight_s=1000.0)
    assert found(drifting(straight, -5.0, ("airspeed0",))) == {}
    assert found(flight) == {}


def test_what_is_remembered_starts_anew_where_the_reference_fails() -> None:
    """Half of the drift is hidden: it may not be dated back beyond the silence."""
    flight = drifting(flown(500.0, pitots=1), -4.0, ("airspeed0",))
    flight["gps0"] = flight["gps0"][~during(flight, "gps0", 200.0, 230.0)]
    for v in judged(flight, AirBankWatch(AirSettings())):
        if v.state is State.FAULTY:
            assert v.onset_t_us is not None
            assert v.onset_t_us >= 230e6
            break
    else:
        pytest.fail("the drift after the silence was not found")


def test_a_pitot_that_drifts_back_is_re_admitted() -> None:
    flight = drifting(flown(480.0), -6.0, ("airspeed0",))
    broken = flight["airspeed0"]["cas_m_s"]
    rows = flown(480.0)["airspeed0"]["cas_m_s"]
    late = during(flight, "airspeed0", 330.0)
    broken[late] = rows[late]
    history = said(judged(flight, AirBankWatch(AirSettings())), "airspeed0")
    states = [s for s, _ in history if s in ("faulty", "ok")]
    assert states == ["ok", "faulty", "ok"]
    assert 338.0 < history[-1][1] < 365.0


def test_a_step_is_still_the_banks() -> None:
    blamed = found(scaled(circuits(200.0), "airspeed0", 0.8, 120.0))
    assert blamed["airspeed0"].estimator == "air_data_3d"


DRIFTING_FLIGHT: Flight = drifting(flown(280.0), -8.0, ("airspeed1",))


@given(st.lists(st.integers(0, 280_000_000), max_size=12))
@settings(max_examples=10, deadline=None)
def test_any_split_gives_the_same_verdicts_and_estimates(cuts: list[int]) -> None:
    whole = AirBankWatch(AirSettings()).step(DRIFTING_FLIGHT, 1 << 60)
    assert any(v.estimator == "air_horizon" for v in whole.verdicts)
    watch = AirBankWatch(AirSettings())
    verdicts: list[Verdict] = []
    estimates = Estimates()
    for low, high in itertools.pairwise([-1, *sorted(cuts), 1 << 60]):
        part = {s: r[(r["t_us"] >= low) & (r["t_us"] < high)] for s, r in DRIFTING_FLIGHT.items()}
        step = watch.step(part, high)
        verdicts += step.verdicts
        estimates.add(step.estimates)
    assert repr(verdicts) == repr(whole.verdicts)
    assert {"air", "air_tests", "air_expected"} == set(whole.estimates)
    for name, rows in estimates.joined().items():
        assert rows.tobytes() == whole.estimates[name].tobytes()
