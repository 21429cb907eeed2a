"""Flying is recognised from speed and height, never from airspeed."""

import numpy as np
import pytest

from links.samples import Rows, empty_rows
from monitor.phase import PhaseTracker
from monitor.settings.phase import PhaseSettings

RATE_HZ = 5


def flight(speed_m_s: np.ndarray, height_m: np.ndarray) -> dict[str, Rows]:
    """GPS and autopilot rows of a flight sampled at 5 Hz."""
    n = len(speed_m_s)
    gps, nav = empty_rows("gps0", n), empty_rows("nav", n)
    for k, rows in enumerate((gps, nav)):
        rows["t_us"] = np.arange(n) * (1_000_000 // RATE_HZ)
        rows["seq"] = 2 * np.arange(n) + k
        rows["vel_ned_m_s"][:, 0] = speed_m_s
        rows["alt_m"] = 584.0 + height_m
    gps["fix_type"] = 3
    gps["vel_ned_m_s"][:, 2] = np.nan
    nav["vel_ned_m_s"][:, 2] = -np.gradient(height_m) * RATE_HZ
    return {"gps0": gps, "nav": nav}


def changes(rows: dict[str, Rows]) -> list[tuple[float, bool]]:
    phase = PhaseTracker(PhaseSettings()).step(rows)
    return [(t / 1e6, bool(f)) for t, f in zip(phase["t_us"], phase["flying"], strict=True)]


T = np.arange(0, 120, 1 / RATE_HZ)


def test_a_parked_aircraft_never_flies() -> None:
    assert changes(flight(np.full(T.shape, 0.3), np.zeros(T.shape))) == []


def test_take_off_is_flight_from_the_stated_height_and_landing_ends_it_before_touchdown() -> None:
    speed = np.interp(T, [20, 25, 100, 110], [0, 20, 20, 0])
    height = np.interp(T, [27, 37, 80, 100], [0, 50, 50, 0])
    (up, flying), (down, still) = changes(flight(speed, height))
    assert (flying, still) == (True, False)
    assert 27 + 15 / 5 <= up < 31.5
    assert 80 + 38 / 2.5 <= down < 96 < 100


def test_a_stream_that_begins_in_flight_is_flight_after_the_confirmation() -> None:
    ((up, flying),) = changes(flight(np.full(T.shape, 18.0), np.full(T.shape, 65.0)))
    assert flying
    assert up == pytest.approx(PhaseSettings().join_s, abs=0.21)


def test_hovering_against_the_wind_is_still_flight() -> None:
    speed = np.interp(T, [20, 25, 60, 65], [0, 20, 20, 1.0])
    height = np.interp(T, [27, 37], [0, 100])
    assert [f for _, f in changes(flight(speed, height))] == [True]


def test_a_frozen_receiver_without_a_fix_is_no_flight() -> None:
    rows = flight(np.full(T.shape, 30.0), np.full(T.shape, 90.0))
    rows["gps0"]["fix_type"] = 1
    del rows["nav"]
    assert changes(rows) == []


def test_without_a_receiver_the_autopilots_velocity_serves() -> None:
    rows = flight(np.full(T.shape, 18.0), np.full(T.shape, 65.0))
    del rows["gps0"]
    assert [f for _, f in changes(rows)] == [True]


@pytest.mark.parametrize("cut", [1, 7, 150, 400])
def test_changes_do_not_depend_on_the_split(cut: int) -> None:
    speed = np.interp(T, [20, 25, 100, 110], [0, 20, 20, 0])
    height = np.interp(T, [27, 37, 80, 100], [0, 50, 50, 0])
    rows = flight(speed, height)
    tracker = PhaseTracker(PhaseSettings())
    parts = [
        tracker.step({s: r[:cut] for s, r in rows.items()}),
        tracker.step({s: r[cut:] for s, r in rows.items()}),
    ]
    whole = PhaseTracker(PhaseSettings()).step(rows)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("cut", [None, 200, 260])
def test_a_vehicle_that_boots_is_on_a_ground_of_its_own(cut: int | None) -> None:
    first, second = 50, 53.0
    speed = np.where(first > T, 18.0, np.interp(T, [70, 75], [0, 20]))
    height = np.where(first > T, 65.0, 200.0 + np.interp(T, [77, 87], [0, 50]))
    rows = flight(speed, height)
    keep = (rows["gps0"]["t_us"] < first * 10**6) | (rows["gps0"]["t_us"] > second * 10**6)
    rows = {s: r[keep] for s, r in rows.items()}
    booted = 51_500_000
    tracker = PhaseTracker(PhaseSettings())
    if cut is None:
        phase = tracker.step(rows, [booted])
    else:  # the boot is told with the first rows after it
        before = tracker.step({s: r[:cut] for s, r in rows.items()}, [booted] if cut > 250 else [])
        after = tracker.step({s: r[cut:] for s, r in rows.items()}, [] if cut > 250 else [booted])
        phase = np.concatenate([before, after])
    assert phase["flying"].tolist() == [True, False, True]
    assert 55.0 <= phase["t_us"][1] / 1e6 < 56.0  # seen standing for two seconds
    assert 80.0 <= phase["t_us"][2] / 1e6 < 82.0


def booted_in_flight(away_s: tuple[float, float], seen: bool = True) -> dict[str, Rows]:
    """A flight at 18 m/s without rows between two times; of a vehicle that says no more of itself
    afterwards unless ``seen``."""
    rows = flight(np.full(T.shape, 18.0), np.where(T < 10.0, 0.0, 65.0))
    for r in rows.values():
        r["vel_ned_m_s"][T < 10.0, 0] = 0.0
    t = rows["gps0"]["t_us"] / 1e6
    keep = (t < away_s[0]) | (t > away_s[1])
    if not seen:
        rows["gps0"]["fix_type"][t > away_s[1]] = 0
        rows["nav"]["vel_ned_m_s"][t > away_s[1]] = np.nan
    return {s: r[keep] for s, r in rows.items()}


@pytest.mark.parametrize("cut", [1, 240, 260, 275, 300])
def test_an_autopilot_that_restarts_in_the_air_flies_on_once_it_has_settled(cut: int) -> None:
    rows, booted = booted_in_flight((50.0, 52.0)), 51_000_000
    tracker = PhaseTracker(PhaseSettings())
    withheld = []
    told = int(rows["gps0"]["t_us"][min(cut, len(rows["gps0"]) - 1)]) > booted
    for part, boots in ((slice(0, cut), told), (slice(cut, None), not told)):
        phase = tracker.step({s: r[part] for s, r in rows.items()}, [booted] if boots else [])
        withheld += tracker.withheld
        assert phase["flying"].all()  # never: on the ground
    assert withheld[-1] == (booted, 56_000_000)
    assert tracker.flying


def test_a_vehicle_that_boots_in_flight_and_says_nothing_is_taken_for_landed() -> None:
    tracker = PhaseTracker(PhaseSettings())
    phase = tracker.step(booted_in_flight((50.0, 52.0), seen=False), [51_000_000])
    assert phase["flying"].tolist() == [True, False]
    assert phase["t_us"][1] == 81_000_000


def test_where_the_ground_was_is_still_known_after_a_restart_in_the_air() -> None:
    rows = booted_in_flight((50.0, 52.0))
    t = rows["gps0"]["t_us"] / 1e6
    for r in rows.values():  # head wind: slow, but high above the ground
        r["vel_ned_m_s"][(t > 70.0), 0] = 2.0
    assert PhaseTracker(PhaseSettings()).step(rows, [51_000_000])["flying"].tolist() == [True]
