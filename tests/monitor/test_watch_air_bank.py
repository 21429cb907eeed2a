"""The pitot watch on synthetic circuits: the broken pitot is found, everything else unmoved."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from links.vocabulary import Kind, Reason, State
from monitor.recording import Estimates
from monitor.settings.air import AirSettings
from monitor.settings.horizon import HorizonSettings
from monitor.verdict import Verdict
from monitor.watch.air_bank import AirBankWatch

from .air_flights import (
    TAKE_OFF_S,
    Flight,
    circuits,
    during,
    judged,
    numbered,
    said,
    scaled,
)


@pytest.fixture
def watch() -> AirBankWatch:
    return AirBankWatch(AirSettings())


def faulty(verdicts: list[Verdict]) -> dict[str, Verdict]:
    """First verdict of faulty per sensor."""
    out: dict[str, Verdict] = {}
    for v in verdicts:
        if v.state is State.FAULTY:
            out.setdefault(v.sensor, v)
    return out


@pytest.mark.parametrize("pitots", [1, 2, 3])
def test_a_healthy_flight_goes_from_ground_to_learning_to_ok(
    watch: AirBankWatch, pitots: int
) -> None:
    verdicts = judged(circuits(200.0, pitots=pitots), watch)
    for k in range(pitots):
        mine = [v for v in verdicts if v.sensor == f"airspeed{k}"]
        assert [(v.state, v.reason) for v in mine] == [
            (State.UNMONITORED, Reason.ON_GROUND),
            (State.UNMONITORED, Reason.LEARNING),
            (State.OK, None),
        ]
        assert mine[1].t_us == TAKE_OFF_S * 1e6
        assert mine[2].t_us < 60e6


def test_on_a_straight_nothing_is_learnt(watch: AirBankWatch) -> None:
    verdicts = judged(circuits(120.0, straight_s=1000.0, pitots=1), watch)
    assert said(verdicts, "airspeed0")[-1][0] == "unmonitored"


@pytest.mark.parametrize(("factor", "kind"), [(0.8, Kind.SCALE), (1.25, Kind.SCALE)])
def test_one_of_two_pitots_off_is_found_within_seconds(
    watch: AirBankWatch, factor: float, kind: Kind
) -> None:
    found = faulty(judged(scaled(circuits(200.0), "airspeed0", factor, 120.0), watch))
    assert set(found) == {"airspeed0"}
    v = found["airspeed0"]
    assert 120.0 < v.t_us * 1e-6 < 124.0
    assert v.kind is kind
    assert v.magnitude == pytest.approx((factor - 1.0) * 17.0, abs=1.5)
    assert v.onset_t_us is not None
    assert abs(v.onset_t_us * 1e-6 - 120.0) < 2.5
    assert v.statistic > v.threshold == 8.0
    assert "airspeed1 agrees" in v.evidence


@pytest.mark.parametrize("sensor", ["airspeed0", "airspeed1", "airspeed2"])
def test_one_of_three_is_found_whichever_it_is(watch: AirBankWatch, sensor: str) -> None:
    flight = scaled(circuits(180.0, pitots=3), sensor, 0.85, 120.0)
    found = faulty(judged(flight, watch))
    assert set(found) == {sensor}
    assert found[sensor].t_us < 124e6


def test_a_single_pitot_is_found_after_turns(watch: AirBankWatch) -> None:
    flight = scaled(circuits(220.0, pitots=1), "airspeed0", 0.75, 120.0)
    found = faulty(judged(flight, watch))
    assert 120.0 < found["airspeed0"].t_us * 1e-6 < 180.0
    assert found["airspeed0"].threshold == 6.0


def test_two_pitots_icing_together_are_blamed_together(watch: AirBankWatch) -> None:
    flight = circuits(300.0)
    for sensor in ("airspeed0", "airspeed1"):
        t = flight[sensor]["t_us"] * 1e-6
        flight[sensor]["cas_m_s"] *= np.exp(-0.005 * np.clip(t - 120.0, 0.0, None))
    found = faulty(judged(flight, watch))
    assert set(found) == {"airspeed0", "airspeed1"}
    assert found["airspeed0"].t_us == found["airspeed1"].t_us
    assert found["airspeed0"].t_us < 200e6
    assert found["airspeed0"].kind is Kind.DRIFT
    assert "so does airspeed1" in found["airspeed0"].evidence


def test_a_change_of_wind_accuses_nobody(watch: AirBankWatch) -> None:
    def wind(t: np.ndarray) -> np.ndarray:
        s = np.clip((t - 120.0) / 5.0, 0.0, 1.0)[:, None]
        return (1 - s) * np.array([4.0, -3.0]) + s * np.array([-2.0, 5.0])

    for pitots in (1, 2):
        watch = AirBankWatch(AirSettings())
        result = watch.step(circuits(260.0, wind=wind, pitots=pitots), 1 << 60)
        assert not faulty(result.verdicts)
        W = result.estimates["air"]["wind_ned_m_s"][-1]
        np.testing.assert_allclose(W[:2], [-2.0, 5.0], atol=0.7)


@pytest.mark.parametrize("along", [5.0, -5.0])
def test_a_wind_that_rises_slowly_along_the_nose_accuses_nobody(
    watch: AirBankWatch, along: float
) -> None:
    def wind(t: np.ndarray) -> np.ndarray:
        front = np.clip((t - 125.0) / 8.0, 0.0, 1.0)[:, None]
        return np.array([4.0, -3.0]) + front * along * np.array([0.0, 1.0])

    assert not faulty(judged(circuits(240.0, wind=wind, pitots=1), watch))


def test_two_pitots_that_step_apart_are_said_to_disagree_before_one_is_named(
    watch: AirBankWatch,
) -> None:
    flight = scaled(scaled(circuits(200.0), "airspeed0", 1.06, 120.0), "airspeed1", 0.94, 120.0)
    verdicts = judged(flight, watch)
    for sensor in ("airspeed0", "airspeed1"):
        mine = [v for v in verdicts if v.sensor == sensor and v.t_us > 120e6]
        assert (mine[0].state, mine[0].reason) == (State.SUSPECT, Reason.SENSORS_DISAGREE)
        assert mine[0].t_us < 123e6
        assert "disagree" in mine[0].evidence


def test_recovery_re_admits_once_and_a_second_fault_waits_longer(watch: AirBankWatch) -> None:
    flight = scaled(circuits(330.0), "airspeed0", 0.75, 100.0, 130.0)
    flight = scaled(flight, "airspeed0", 1.3, 200.0, 230.0)
    history = [s for s in said(judged(flight, watch), "airspeed0") if s[0] in ("faulty", "ok")]
    states = [s for s, _ in history]
    assert states == ["ok", "faulty", "ok", "faulty", "ok"]
    times = [t for _, t in history]
    assert 10.0 < times[2] - 130.0 < 16.0
    assert 20.0 < times[4] - 230.0 < 27.0


def test_a_partly_cleared_pitot_stays_faulty(watch: AirBankWatch) -> None:
    flight = scaled(circuits(300.0), "airspeed0", 4.0, 100.0, 120.0)
    flight = scaled(flight, "airspeed0", 1.4, 120.0, 240.0)
    history = [s for s in said(judged(flight, watch), "airspeed0") if s[0] in ("faulty", "ok")]
    assert [s for s, _ in history] == ["ok", "faulty", "ok"]
    assert history[1][1] < 102.5
    assert 240.0 < history[2][1] < 260.0


@pytest.mark.parametrize("pressure_noise_pa", [0.0, 8.0])
def test_a_stuck_pitot(watch: AirBankWatch, pressure_noise_pa: float) -> None:
    flight = circuits(160.0)
    pressure = flight["baro0"]["static_press_pa"]
    pressure += pressure_noise_pa * np.random.default_rng(5).standard_normal(len(pressure))
    rows = flight["airspeed1"]
    rows["cas_m_s"][during(flight, "airspeed1", 120.0)] = 17.0
    found = faulty(judged(flight, watch))
    assert set(found) == {"airspeed1"}
    assert found["airspeed1"].kind is Kind.STUCK
    assert 122.0 < found["airspeed1"].t_us * 1e-6 < 122.5


def test_noise_of_one_of_two(watch: AirBankWatch) -> None:
    flight = circuits(200.0)
    bad = during(flight, "airspeed0", 120.0, 150.0)
    noise = np.random.default_rng(3).standard_normal(bad.sum())
    flight["airspeed0"]["cas_m_s"][bad] *= 1.0 + 0.08 * noise
    verdicts = judged(flight, watch)
    found = faulty(verdicts)
    assert set(found) == {"airspeed0"}
    assert found["airspeed0"].kind is Kind.NOISE
    assert found["airspeed0"].t_us < 123e6
    assert said(verdicts, "airspeed0")[-1][0] == "ok"


def test_a_slow_oscillation_of_one_of_two(watch: AirBankWatch) -> None:
    flight = circuits(200.0)
    bad = during(flight, "airspeed0", 120.0, 150.0)
    t = flight["airspeed0"]["t_us"][bad] * 1e-6 - 120.0
    flight["airspeed0"]["cas_m_s"][bad] *= 1.0 + 0.12 * np.sin(2.0 * np.pi * 0.7 * t)
    verdicts = judged(flight, watch)
    found = faulty(verdicts)
    assert set(found) == {"airspeed0"}
    v = found["airspeed0"]
    assert v.kind is Kind.OSCILLATION
    assert v.t_us < 124e6
    assert v.onset_t_us is not None
    assert abs(v.onset_t_us * 1e-6 - 120.0) < 1.0
    assert "airspeed0 has swung by" in v.evidence
    assert [s for s, _ in said(verdicts, "airspeed0")][-2:] == ["faulty", "ok"]
    assert said(verdicts, "airspeed0")[-1][1] > 155.0


@pytest.mark.parametrize("present", [True, False])
def test_a_pitot_that_never_leaves_zero(watch: AirBankWatch, present: bool) -> None:
    flight = circuits(60.0)
    flight["sys_status"]["present"] = 16 if present else 0
    for sensor in ("airspeed0", "airspeed1"):
        flight[sensor]["cas_m_s"] = 0.0
    verdicts = judged(flight, watch)
    found = faulty(verdicts)
    assert set(found) == ({"airspeed0"} if present else set())
    if present:
        assert found["airspeed0"].t_us * 1e-6 < TAKE_OFF_S + 3.0
    assert said(verdicts, "airspeed1")[-1][0] == "absent"


def test_a_vehicle_without_pitots_is_left_alone(watch: AirBankWatch) -> None:
    flight = circuits(60.0, pitots=0)
    result = watch.step(flight, 1 << 60)
    assert result.verdicts == []
    assert len(result.estimates["air"])


def test_without_gps_nothing_is_judged_and_afterwards_it_goes_on(watch: AirBankWatch) -> None:
    flight = scaled(circuits(250.0), "airspeed0", 0.8, 130.0, 160.0)
    flight["gps0"] = flight["gps0"][~during(flight, "gps0", 120.0, 170.0)]
    mine = [v for v in judged(flight, watch) if v.sensor == "airspeed0"]
    assert [(v.state, v.reason) for v in mine[-2:]] == [
        (State.UNMONITORED, Reason.REFERENCE_MISSING),
        (State.OK, None),
    ]
    assert 122.0 < mine[-2].t_us * 1e-6 < 123.5


def test_a_noisy_gps_is_not_trusted_and_blames_no_pitot(watch: AirBankWatch) -> None:
    flight = circuits(250.0)
    bad = during(flight, "gps0", 120.0, 150.0)
    noise = np.random.default_rng(4).uniform(-4.0, 4.0, bad.sum())
    flight["gps0"]["vel_ned_m_s"][bad, 1] += noise
    verdicts = judged(flight, watch)
    assert not faulty(verdicts)
    assert Reason.REFERENCE_NOT_TRUSTED in {v.reason for v in verdicts}
    assert said(verdicts, "airspeed0")[-1][0] == "ok"


def test_repeated_gps_records_change_nothing(watch: AirBankWatch) -> None:
    flight = circuits(120.0)
    doubled = flight["gps0"].repeat(2)
    doubled["t_us"][1::2] += 90_000
    repeated = numbered({**flight, "gps0": doubled})
    once = judged(circuits(120.0), AirBankWatch(AirSettings()))
    twice = judged(repeated, watch)
    assert [(v.sensor, v.state) for v in twice] == [(v.sensor, v.state) for v in once]


def test_errors_are_as_large_as_their_sigmas_say(watch: AirBankWatch) -> None:
    inside, total = 0, 0
    for seed in range(6):
        wind = 6.0 * np.array([np.cos(seed), np.sin(seed)])
        flight = circuits(200.0, wind=(wind[0], wind[1]), gust=0.5, seed=seed)
        air = AirBankWatch(AirSettings()).step(flight, 1 << 60).estimates["air"]
        late = air[air["t_us"] > 60e6]
        error = np.abs(late["wind_ned_m_s"][:, :2] - wind)
        inside += (error < 2.0 * late["wind_std_ned_m_s"][:, :2]).sum()
        total += error.size
        assert np.sqrt((error[-200:] ** 2).mean()) < 0.5
    assert inside / total > 0.9


FAULTY_FLIGHT: Flight = scaled(circuits(130.0), "airspeed0", 0.8, 90.0)


@given(st.lists(st.integers(0, 130_000_000), max_size=12))
@settings(max_examples=15, deadline=None)
def test_any_split_gives_the_same_verdicts_and_estimates(cuts: list[int]) -> None:
    whole = AirBankWatch(AirSettings()).step(FAULTY_FLIGHT, 1 << 60)
    watch = AirBankWatch(AirSettings())
    verdicts: list[Verdict] = []
    estimates = Estimates()
    edges = [-1, *sorted(cuts), 1 << 60]
    for low, high in itertools.pairwise(edges):
        part = {s: r[(r["t_us"] >= low) & (r["t_us"] < high)] for s, r in FAULTY_FLIGHT.items()}
        step = watch.step(part, high)
        verdicts += step.verdicts
        estimates.add(step.estimates)
    assert repr(verdicts) == repr(whole.verdicts)
    assert {"air", "air_tests", "air_expected"} == set(whole.estimates)
    for name, rows in estimates.joined().items():
        assert rows.tobytes() == whole.estimates[name].tobytes()


@pytest.mark.parametrize(
    ("pitots", "key", "size"),
    [
        (2, "margin_one", 0.9),
        (1, "margin_single", 0.85),
        (2, "min_shift", 0.94),
    ],
)
def test_a_limit_above_the_peak_is_not_exceeded_and_one_below_is(
    pitots: int, key: str, size: float
) -> None:
    flight = scaled(circuits(200.0, pitots=pitots), "airspeed0", size, 120.0)
    every = ("margin_one", "margin_all", "margin_single")
    out_of_reach = dict.fromkeys(every, 1e3) if key != "min_shift" else {}
    alone = {"horizon": HorizonSettings(margin_one=1e9, margin_all=1e9)}
    blind = {**out_of_reach, **alone, "min_shift": 0.02, key: 1e3}
    watch = AirBankWatch(AirSettings(**blind))
    assert not faulty(judged(flight, watch))
    peak = watch.peaks()[f"air.{key}"]
    assert not faulty(judged(flight, AirBankWatch(AirSettings(**blind | {key: 1.001 * peak}))))
    found = faulty(judged(flight, AirBankWatch(AirSettings(**blind | {key: 0.8 * peak}))))
    assert set(found) == {"airspeed0"}


def test_a_healthy_flight_stays_below_its_limits(watch: AirBankWatch) -> None:
    judged(circuits(200.0), watch)
    limits = AirSettings().model_dump()
    limits |= {f"horizon.{key}": limit for key, limit in limits["horizon"].items()}
    assert {
        "air.margin_one",
        "air.gross_ln",
        "air.noise_rms",
        "air.reference_apart_m_s",
        "air.dead_wind_m_s",
    } <= set(watch.peaks())
    for key, reached in watch.peaks().items():
        assert 0.0 <= reached < limits[key.removeprefix("air.")], key
