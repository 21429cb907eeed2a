"""A flight as its report sees it: series that keep every peak, states without gaps, a track."""

from __future__ import annotations

import numpy as np
import pytest

from links.vocabulary import State
from monitor.report.flight import Flight
from tests.monitor.report.analysed import analysed


def test_the_synthetic_flight_has_what_a_report_draws(flight: Flight) -> None:
    faults = {f["sensor"] for f in flight.summary["faults"]}
    assert faults == {"airspeed0", "imu0.acc_x"}
    for name, unit in {
        "imu0.acc_x": "m/s^2",
        "imu1.gyro_z": "rad/s",
        "airspeed0": "m/s",
        "airspeed1": "m/s",
        "gps0.speed": "m/s",
        "gps0.course": "rad",
        "altitude": "m",
        "baro_altitude": "m",
        "roll": "rad",
        "heading": "rad",
    }.items():
        series = flight.measured(name)
        assert series is not None, name
        assert series.unit == unit
        assert 200 < len(series) < 1300, name
        assert (series.t_s >= 0).all()
        assert (series.t_s <= flight.duration_s).all()
        assert (np.diff(series.t_s) > 0).all()
    cas = flight.estimate("air", "cas_m_s", 80.0, 90.0)
    assert cas is not None
    assert np.nanmedian(cas.middle) == pytest.approx(20.0, abs=2.0)
    low = flight.measured("airspeed0", 80.0, 90.0)
    assert low is not None
    assert np.nanmedian(low.middle) == pytest.approx(0.6 * 20.0, abs=2.0)


def test_what_a_log_has_not_is_none_and_what_nothing_has_is_an_error(flight: Flight) -> None:
    assert flight.measured("imu4.acc_x") is None
    assert flight.measured("aoa2") is None
    assert flight.estimate("wing", "right_lift_percent") is None
    for name in ("imu0", "imu0.acc", "airspeed0.acc_x", "gps0.acc_x", "wing_left.lift", "x"):
        with pytest.raises(KeyError, match="nothing that is measured"):
            flight.measured(name)
    with pytest.raises(KeyError, match="has no column cas; it has t_us, cas_m_s"):
        flight.estimate("air", "cas")


def test_every_sensor_has_a_state_at_every_moment(flight: Flight) -> None:
    assert {"airspeed0", "airspeed1", "imu0.acc_x", "imu1.gyro_z", "gps0", "attitude"} <= set(
        flight.spans
    )
    for spans in flight.spans.values():
        assert spans[0].from_s == 0.0
        assert spans[-1].to_s == flight.duration_s
        assert [s.to_s for s in spans[:-1]] == [s.from_s for s in spans[1:]]
    faulty = [s for s in flight.spans["airspeed0"] if s.state is State.FAULTY]
    (fault,) = (f for f in flight.summary["faults"] if f["sensor"] == "airspeed0")
    assert faulty[0].from_s == pytest.approx(fault["isolated_s"], abs=1e-3)
    assert faulty[-1].to_s == pytest.approx(fault["cleared_s"], abs=1e-3)
    assert faulty[0].evidence == fault["evidence"]
    assert faulty[0].kind == fault["kind"]


def test_the_track_is_as_long_as_the_speed_says(flight: Flight) -> None:
    track = flight.track()
    assert track is not None
    assert track.source == "gps0"
    flown_m = np.nansum(np.hypot(np.diff(track.north_m), np.diff(track.east_m)))
    speed = flight.measured("gps0.speed")
    assert speed is not None
    assert flown_m == pytest.approx(np.nanmean(speed.middle) * np.ptp(track.t_s), rel=0.03)


def test_a_peak_of_one_sample_is_in_every_series(flight: Flight) -> None:
    rows = flat_table(flight, "measured_imu0")
    for points in (1, 7, 300, 100_000):
        series = flight.measured("imu0.acc_z", points=points)
        assert series is not None
        assert np.nanmin(series.low) == np.nanmin(rows["acc_z_low_m_s2"])
        assert np.nanmax(series.high) == np.nanmax(rows["acc_z_high_m_s2"])


def flat_table(flight: Flight, name: str) -> dict[str, np.ndarray]:
    columns = flight.tables.columns(name)
    pieces = zip(*flight.tables.read(name, columns, -(1 << 60), 1 << 60), strict=True)
    return dict(zip(columns, map(np.concatenate, pieces), strict=True))


def test_radians_are_shown_as_degrees(flight: Flight) -> None:
    roll = flight.measured("roll")
    assert roll is not None
    assert roll.shown().unit == "deg"
    np.testing.assert_allclose(roll.shown().high, np.degrees(roll.high))
    rate = flight.measured("imu0.gyro_x")
    assert rate is not None
    assert rate.shown().unit == "deg/s"
    speed = flight.measured("airspeed0")
    assert speed is not None
    assert speed.shown().unit == "m/s"


def test_a_recorded_pitot_fault_is_in_its_series(recorded) -> None:
    flight = recorded("sitl/f2_pitot_block_pressure.tlog")
    (fault,) = flight.summary["faults"]
    assert fault["sensor"] == "airspeed0"
    states = {s.state for s in flight.spans["airspeed0"]}
    assert {State.OK, State.FAULTY, State.UNMONITORED} <= states
    assert flight.measured("throttle") is not None


def test_a_vehicle_that_booted_anew_in_the_log_is_one_flight(synthetic_log, tmp_path) -> None:
    """The same flight twice in one log: vehicle time goes on, and lines break where it began."""
    data = synthetic_log.read_bytes()
    (tmp_path / "twice.tlog").write_bytes(data + data)
    flight = analysed(tmp_path / "twice.tlog")
    (boot_s,) = flight.summary["log"]["boots_s"]
    assert flight.duration_s == pytest.approx(2.0 * boot_s, rel=0.02)
    for name in ("imu0.acc_x", "airspeed0", "gps0.speed", "heading"):
        series = flight.measured(name, points=100_000)
        assert series is not None
        assert (np.diff(series.t_s) > 0).all()
        assert series.t_s[-1] == pytest.approx(flight.duration_s, abs=2.0)
    imu = flight.measured("imu0.acc_x")
    assert imu is not None
    (broken,) = imu.t_s[np.isnan(imu.low)]
    assert broken == pytest.approx(boot_s, abs=1.0)
    for spans in flight.spans.values():
        assert [s.to_s for s in spans[:-1]] == [s.from_s for s in spans[1:]]
        assert spans[-1].to_s == flight.duration_s
    assert sum(s.state is State.FAULTY for s in flight.spans["airspeed0"]) >= 2
