"""The triplex watch on a synthetic transport: one thing broken, everything else unmoved."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from links.mavlink import Decoder
from links.samples import Batch
from links.vocabulary import Kind, Reason, State
from monitor.pipeline import Pipeline
from monitor.settings import load as load_settings
from monitor.verdict import Verdict
from monitor.watch.air_triplex import AirTriplexWatch
from sim_feeds.player import frames
from sim_feeds.scenario import load as load_scenario

KT = 0.514444
DEG = math.radians(1.0)
ONSET_S = 62.0
"""Seconds after the first row: 20 s of level flight, then in the second turn."""


def _flight(
    scenario: str, pitots: int = 3, vanes: int = 3, seed: int = 1, gust: float = 1.0
) -> Batch:
    def three_of_each(table: dict) -> None:
        table["airspeed"] = {**table.get("airspeed", {}), "count": pitots}
        table["aoa"] = {**table.get("aoa", {}), "count": vanes, "rate_hz": 20.0}
        table["fault"] = []
        for wind in table["wind"]:
            if wind["kind"] == "dryden":
                for key in wind.keys() & {"wind_6m_m_s", "high_std_m_s"}:
                    wind[key] *= gust

    decoder = Decoder()
    played = frames(load_scenario(scenario, three_of_each), seed)
    return Batch.concatenate([decoder.feed(b"".join(frame for _, frame in played))])


@pytest.fixture(scope="module")
def transport() -> Batch:
    """Two minutes at 190 m/s in flight: level, two turns of 60 degrees, a load doublet, level."""
    return _flight("transport-cas-runaway", gust=2.0)


def _broken(batch: Batch, sensor: str, change: Callable, onset_s: float = ONSET_S,
            end_s: float = np.inf) -> Batch:  # fmt: skip
    """The batch with ``change(reading, seconds since onset)`` on one sensor."""
    rows = dict(batch.rows)
    r = rows[sensor].copy()
    field = "cas_m_s" if sensor.startswith("airspeed") else "aoa_rad"
    since = (r["t_us"] - _start_us(batch)) * 1e-6 - onset_s
    on = (since >= 0) & (since < end_s - onset_s)
    r[field][on] = change(r[field][on], since[on])
    if field == "cas_m_s":
        r[field] = np.maximum(r[field], 0.0)
    rows[sensor] = r
    return Batch(rows)


def _start_us(batch: Batch) -> int:
    return int(batch.rows["attitude"]["t_us"][0])


def _judged(batch: Batch, profile: str = "transport", cuts: int = 1) -> list[Verdict]:
    settings = load_settings(profile)
    pipeline = Pipeline(settings, watches=[AirTriplexWatch(settings.triplex)])
    seqs = batch.rows["attitude"]["seq"][:: max(len(batch.rows["attitude"]) // cuts, 1)][1:]
    verdicts = []
    for part in batch.split([int(s) for s in seqs]) if cuts > 1 else [batch]:
        verdicts += pipeline.feed(part).verdicts
    verdicts += pipeline.finish().verdicts
    return [v for v in verdicts if v.sensor.startswith(("airspeed", "aoa"))]


def _faults(batch: Batch, verdicts: list[Verdict]) -> dict[str, tuple[float, Verdict]]:
    """Sensor -> (seconds from the first row to its first conviction, that verdict)."""
    out: dict[str, tuple[float, Verdict]] = {}
    for v in verdicts:
        if v.state is State.FAULTY:
            out.setdefault(v.sensor, ((v.t_us - _start_us(batch)) * 1e-6, v))
    return out


def _cleared(verdicts: list[Verdict]) -> set[str]:
    gone: set[str] = set()
    seen: set[str] = set()
    for v in verdicts:
        if v.state is State.FAULTY:
            seen.add(v.sensor)
        elif v.state is State.OK and v.sensor in seen:
            gone.add(v.sensor)
    return gone


def _stuck(x: np.ndarray, _: np.ndarray) -> np.ndarray:
    return np.full_like(x, x[0])


SINGLE = {
    # name: (sensor, change, kind, within seconds)
    "bias": ("airspeed1", lambda x, t: x + 12.0, Kind.BIAS, 2.0),
    "low": ("airspeed0", lambda x, t: x - 25 * KT, Kind.BIAS, 2.0),
    "non-return to zero": ("airspeed2", lambda x, t: 0.9 * x, Kind.BIAS, 2.0),
    "drift": ("airspeed2", lambda x, t: x - 1.0 * t, Kind.DRIFT, 12.0),
    "runaway": ("airspeed0", lambda x, t: x - 15 * KT * t, Kind.RUNAWAY, 3.0),
    "oscillation": ("airspeed1", lambda x, t: x + 15 * np.sin(np.pi * t), Kind.OSCILLATION, 3.0),
    "noise": (
        "airspeed1",
        lambda x, t: x + 8 * np.random.default_rng(2).normal(size=len(x)),
        Kind.NOISE,
        2.0,
    ),
    "stuck": ("airspeed0", _stuck, Kind.STUCK, 25.0),
    "dead": ("airspeed0", lambda x, t: 0.0 * x, Kind.STUCK, 2.0),
    "vane bias": ("aoa1", lambda x, t: x - 4 * DEG, Kind.BIAS, 2.0),
    "vane drift": ("aoa0", lambda x, t: x + 0.3 * DEG * t, Kind.DRIFT, 12.0),
    "vane runaway": ("aoa2", lambda x, t: x + 5 * DEG * t, Kind.RUNAWAY, 2.0),
    "vane oscillation": (
        "aoa2",
        lambda x, t: x + 5 * DEG * np.sin(np.pi * t),
        Kind.OSCILLATION,
        3.0,
    ),
    "vane noise": (
        "aoa0",
        lambda x, t: x + 3 * DEG * np.random.default_rng(2).normal(size=len(x)),
        Kind.NOISE,
        3.0,
    ),
    "vane stuck": ("aoa1", _stuck, Kind.STUCK, 25.0),
}


def test_healthy_sensors_go_from_learning_to_ok_and_stay(transport: Batch) -> None:
    verdicts = _judged(transport)
    for sensor in ("airspeed0", "airspeed1", "airspeed2", "aoa0", "aoa1", "aoa2"):
        mine = [v for v in verdicts if v.sensor == sensor]
        assert [v.state for v in mine if v.reason is not Reason.ON_GROUND] == [
            State.UNMONITORED,
            State.OK,
        ]
        assert mine[-2].reason is Reason.LEARNING


@pytest.mark.parametrize(
    ("scenario", "profile"),
    [("small-uav-healthy", "small-uav"), ("light-aircraft-vane", "light-aircraft")],
)
def test_healthy_small_aircraft_in_gusts_get_no_verdict(scenario: str, profile: str) -> None:
    """Take-off, circuits with 25 to 30 degrees of bank, twice the scenario's turbulence."""
    verdicts = _judged(_flight(scenario, gust=2.0), profile)
    assert {v.sensor for v in verdicts if v.state is State.OK} >= {"airspeed2", "aoa2"}
    assert not [v for v in verdicts if v.state in (State.FAULTY, State.SUSPECT)]


@pytest.mark.parametrize("name", SINGLE)
def test_one_broken_sensor_in_a_turn(transport: Batch, name: str) -> None:
    sensor, change, kind, within_s = SINGLE[name]
    verdicts = _judged(_broken(transport, sensor, change))
    faults = _faults(transport, verdicts)
    assert set(faults) == {sensor}
    at_s, verdict = faults[sensor]
    assert ONSET_S < at_s < ONSET_S + within_s
    assert verdict.kind is kind
    onset_s = (verdict.onset_t_us - _start_us(transport)) * 1e-6
    assert ONSET_S - 1.0 < onset_s <= at_s
    assert sensor in verdict.evidence
    assert verdict.unit == ("m/s" if sensor.startswith("airspeed") else "rad")
    assert abs(verdict.statistic) >= verdict.threshold or kind is Kind.STUCK
    assert not _cleared(verdicts)


def test_magnitude_is_measured_minus_reconstructed(transport: Batch) -> None:
    for size in (12.0, -20.0):
        faults = _faults(
            transport, _judged(_broken(transport, "airspeed1", lambda x, t, s=size: x + s))
        )
        assert faults["airspeed1"][1].magnitude == pytest.approx(size, abs=1.5)
        side = "above" if size > 0 else "below"
        assert side in faults["airspeed1"][1].evidence


def test_a_recovered_sensor_comes_back(transport: Batch) -> None:
    verdicts = _judged(_broken(transport, "airspeed1", lambda x, t: x + 15, end_s=ONSET_S + 15.0))
    back = [v for v in verdicts if v.sensor == "airspeed1"][-1]
    assert back.state is State.OK
    assert 85.0 < (back.t_us - _start_us(transport)) * 1e-6 < 95.0


@pytest.mark.parametrize(
    ("sensors", "change", "within_s"),
    [
        (("airspeed0", "airspeed1"), lambda x, t: x - 30 * KT, 3.0),
        (("airspeed1", "airspeed2"), lambda x, t: x + 40 * KT * np.sin(np.pi * t), 4.0),
        (("aoa0", "aoa1"), lambda x, t: x + 5 * DEG, 4.0),
    ],
)
def test_two_of_three_that_agree_do_not_outvote_the_healthy_one(
    transport: Batch, sensors: tuple[str, ...], change: Callable, within_s: float
) -> None:
    batch = transport
    for sensor in sensors:
        batch = _broken(batch, sensor, change)
    faults = _faults(transport, _judged(batch))
    assert set(faults) == set(sensors)
    assert all(ONSET_S < at_s < ONSET_S + within_s for at_s, _ in faults.values())
    assert "wind" in faults[sensors[0]][1].evidence


@pytest.mark.parametrize(("rate_kt_s", "within_s"), [(-15.0, 5.0), (-5.0, 16.0)])
def test_all_pitots_running_away_are_found_by_the_wind_bound_and_stay_found(
    transport: Batch, rate_kt_s: float, within_s: float
) -> None:
    batch = transport
    for sensor in ("airspeed0", "airspeed1", "airspeed2"):
        batch = _broken(batch, sensor, lambda x, t: x + rate_kt_s * KT * t)
    verdicts = _judged(batch)
    faults = _faults(transport, verdicts)
    assert set(faults) == {"airspeed0", "airspeed1", "airspeed2"}
    assert all(at_s < ONSET_S + within_s for at_s, _ in faults.values())
    assert not _cleared(verdicts)
    assert "wind" in faults["airspeed0"][1].evidence


def test_the_estimate_does_not_follow_a_fault(transport: Batch) -> None:
    settings = load_settings("transport")

    def cas(batch: Batch) -> np.ndarray:
        pipeline = Pipeline(settings, watches=[AirTriplexWatch(settings.triplex)])
        results = pipeline.feed(batch), pipeline.finish()
        return np.concatenate([r.estimates["air"] for r in results if "air" in r.estimates])

    healthy = cas(transport)
    broken = cas(_broken(transport, "airspeed1", lambda x, t: x + 20.0))
    np.testing.assert_array_equal(healthy["t_us"], broken["t_us"])
    late = healthy["t_us"] > _start_us(transport) + (ONSET_S + 2) * 1e6
    assert np.abs(healthy["cas_m_s"] - broken["cas_m_s"])[late].max() < 1.0
    assert np.degrees(np.abs(healthy["aoa_rad"] - broken["aoa_rad"])[late].max()) < 0.3
    assert np.isfinite(healthy["wind_std_ned_m_s"]).all()


def test_two_pitots_and_two_vanes(transport: Batch) -> None:
    rows = {s: r for s, r in transport.rows.items() if s not in ("airspeed2", "aoa2")}
    pair = Batch(rows)
    assert not _faults(pair, _judged(pair))
    for sensor, change in (
        ("airspeed1", lambda x, t: x - 25.0),
        ("aoa0", lambda x, t: x + 6 * DEG),
    ):
        verdicts = _judged(_broken(pair, sensor, change))
        faults = _faults(pair, verdicts)
        assert set(faults) == {sensor}
        assert faults[sensor][0] < ONSET_S + 6.0


def test_without_references_the_votes_still_work(transport: Batch) -> None:
    rows = {s: r for s, r in transport.rows.items() if s[:3] in ("air", "aoa") or s == "phase"}
    rows["gps0"] = transport.rows["gps0"]  # the flight phase needs it
    blind = Batch(rows)
    settings = load_settings("transport")
    pipeline = Pipeline(settings, watches=[AirTriplexWatch(settings.triplex)])
    broken = Batch({**_with_attitude_times(transport, blind, "airspeed1")})
    verdicts = pipeline.feed(broken).verdicts + pipeline.finish().verdicts
    found = {v.sensor for v in verdicts if v.state is State.FAULTY}
    assert found == {"airspeed1"}


def _with_attitude_times(whole: Batch, blind: Batch, sensor: str) -> dict:
    """Rows of ``blind`` with one sensor 15 m/s high from the onset on."""
    return {
        s: r
        for s, r in _broken(whole, sensor, lambda x, t: x + 15.0).rows.items()
        if s in blind.rows
    }


def test_any_cut_of_the_stream_gives_the_same_verdicts(transport: Batch) -> None:
    batch = _broken(transport, "airspeed1", lambda x, t: x + 12.0)
    batch = _broken(batch, "aoa0", lambda x, t: x + 0.3 * DEG * t, onset_s=80.0)
    whole = _judged(batch)
    assert whole == _judged(batch, cuts=7)
    assert whole == _judged(batch, cuts=300)


@pytest.mark.parametrize("gap_s", [1.0, 3.0, 12.0])
def test_a_gap_in_the_data_is_no_sensor_that_stands_still(transport: Batch, gap_s: float) -> None:
    t = {s: (r["t_us"] - _start_us(transport)) * 1e-6 for s, r in transport.rows.items()}
    kept = {s: r[(t[s] < 20.0) | (t[s] % 26.0 > gap_s)] for s, r in transport.rows.items()}
    verdicts = _judged(Batch(kept))
    assert _faults(transport, verdicts) == {}
    assert {v.sensor for v in verdicts if v.state is State.OK} == {
        *(f"airspeed{i}" for i in range(3)),
        *(f"aoa{i}" for i in range(3)),
    }


def test_a_sensor_that_stands_still_is_found_across_gaps(transport: Batch) -> None:
    batch = _broken(transport, "airspeed0", _stuck)
    t = {s: (r["t_us"] - _start_us(transport)) * 1e-6 for s, r in batch.rows.items()}
    kept = {s: r[(t[s] < 20.0) | (t[s] % 9.0 > 1.0)] for s, r in batch.rows.items()}
    found = _faults(transport, _judged(Batch(kept)))
    assert set(found) == {"airspeed0"}
    assert found["airspeed0"][0] < ONSET_S + 25.0
