"""The monitor in another program: the same verdicts as of a log, whatever it is fed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor import (
    ArraySource,
    Batch,
    Estimates,
    Monitor,
    Rejection,
    StepResult,
    Verdict,
    analyze_log,
    load_settings,
    open_log,
)


def told(results: list[StepResult]) -> list[Verdict]:
    return [verdict for result in results for verdict in result.verdicts]


def test_bytes_batches_and_a_log_give_the_same_verdicts(
    blockage_frames: list[tuple[int, bytes]], blockage_log: Path
) -> None:
    live, replay = Monitor(), Monitor(load_settings("small-uav"))
    stream = b"".join(frame for _, frame in blockage_frames)
    pieces = [stream[at : at + 1000] for at in range(0, len(stream), 1000)]
    of_bytes = told([live.feed(piece) for piece in pieces] + [live.finish()])
    of_batches = told([replay.feed(batch) for batch in open_log(blockage_log)] + [replay.finish()])
    estimates = Estimates()
    analysis = analyze_log(str(blockage_log), sink=estimates)
    assert [v.sensor for v in of_bytes if v.state == "faulty"] == ["airspeed0", "airspeed1"]
    assert [str(v) for v in of_bytes] == [str(v) for v in of_batches]
    assert [str(v) for v in of_batches] == [str(v) for v in analysis.verdicts]
    assert live.vehicle is not None
    assert live.vehicle.system_id == analysis.summary["vehicle"]["system_id"]
    assert live.states["airspeed0"].t_us <= live.now_us
    assert {"air", "imu0"} <= set(estimates.joined())


def test_a_monitor_is_fed_one_thing_all_its_life() -> None:
    of_bytes, of_samples = Monitor(), Monitor()
    of_bytes.feed(b"")
    with pytest.raises(TypeError, match="fed bytes takes no Batch"):
        of_bytes.feed(Batch())
    of_samples.feed(Batch())
    with pytest.raises(TypeError, match="fed bytes"):
        of_samples.feed(b"")
    with pytest.raises(TypeError, match="not str"):
        Monitor().feed("text")  # type: ignore[arg-type]


def test_what_is_no_number_is_no_exception() -> None:
    t_s = np.arange(1.0, 30.0, 0.1)
    bad = np.where(np.arange(len(t_s)) % 3 == 0, np.inf, -np.inf)
    sensors = {
        "gps0": {"t_s": t_s, "vel_ned_m_s": np.column_stack((bad, bad, bad)), "alt_m": bad},
        "airspeed0": {"t_s": t_s, "cas_m_s": bad},
    }
    sentry = Monitor()
    sentry.feed(ArraySource().batch(sensors))
    sentry.finish()
    assert not sentry.flying
    assert sentry.rejected["gps0", Rejection.NON_FINITE] == len(t_s)
    sentry = Monitor()
    sentry.feed(b"\x00garbage")
    sentry.finish()
    assert sentry.rejected["frame", Rejection.GARBAGE] == 8


def test_arrays_are_numbered_as_they_come() -> None:
    source = ArraySource()
    first = source.batch(
        {"airspeed0": {"t_s": [1.0, 3.0], "cas_m_s": [20.0, 21.0]}, "aoa0": {"t_us": [2_000_000]}}
    )
    then = source.batch({"gps0": {"t_s": [4.0], "alt_m": [99.0]}})
    assert first.rows["airspeed0"]["seq"].tolist() == [0, 2]
    assert first.rows["aoa0"]["seq"].tolist() == [1]
    assert np.isnan(first.rows["aoa0"]["aoa_rad"]).all()
    (fix,) = then.rows["gps0"]
    assert (fix["seq"], fix["t_us"], fix["fix_type"], fix["stamp_us"]) == (3, 4e6, 3, 4e6)
    assert np.isnan(fix["vel_ned_m_s"]).all()
    assert len(source.batch({})) == 0


@pytest.mark.parametrize(
    ("sensor", "fields", "why"),
    [
        ("pitot0", {"t_s": [1.0]}, "no sensor pitot0; known are imu"),
        ("aoa0", {"t_s": [1.0], "aoa_deg": [3.0]}, "no field aoa_deg; known are aoa_rad"),
        ("aoa0", {"aoa_rad": [0.1]}, "needs its times"),
        ("aoa0", {"t_us": [1.5]}, "t_s takes seconds"),
        ("aoa0", {"t_s": [np.nan]}, "all finite"),
        ("aoa0", {"t_s": [[1.0]]}, r"times of shape \(1, 1\)"),
        ("imu0", {"t_s": [1.0], "acc_m_s2": [1.0, 2.0, 3.0]}, r"shape \(3,\), not \(1, 3\)"),
        ("heartbeat", {"t_s": [1.0]}, "lacks vehicle_type"),
    ],
)
def test_arrays_that_cannot_be_meant_are_refused(sensor: str, fields: dict, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        ArraySource().batch({sensor: fields})
