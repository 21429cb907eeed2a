"""The autopilots' own checks beside ours: what the summary says, and the holes they have."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from links.logs import open_log
from links.samples import Batch, empty_rows
from links.vocabulary import State
from monitor.baselines import BaselineTap, one_line
from monitor.pipeline import Pipeline
from monitor.settings import Settings
from monitor.watch.air_bank import AirBankWatch
from tests.monitor.air_flights import Flight, circuits, judged, numbered, scaled

AS_RECORDED = {"ARSPD_OPTIONS": 3.0, "ARSPD_WIND_MAX": 0.0}
"""As the recorded flights had it: the EKF's consistency is not asked for."""


def with_parameters(flight: Flight, **values: float) -> Flight:
    """The flight with ArduPilot parameters at its beginning."""
    rows = empty_rows("param", len(values))
    for row, (name, value) in zip(rows, values.items(), strict=True):
        row["name"], row["value"] = name.encode(), value
    return numbered(flight | {"param": rows})


def logic(flight: Flight) -> dict[str, Any]:
    """What the autopilots' checks say of a flight."""
    tap = BaselineTap()
    tap.step(flight)
    return tap.summary(0)


def disabled(found: dict[str, Any], sensor: str = "airspeed0") -> list[dict[str, Any]]:
    return [e for e in found["ardupilot"] if (e["check"], e["sensor"]) == ("disabled", sensor)]


def found_by_us(flight: Flight) -> list[tuple[str, float]]:
    """(sensor, time) of our verdicts of faulty."""
    verdicts = judged(flight, AirBankWatch(Settings().air))
    return [(v.sensor, v.t_us * 1e-6) for v in verdicts if v.state is State.FAULTY]


# --------------------------------------------------------------------------- what is written


def test_the_logs_parameters_count_and_the_summary_says_which() -> None:
    flight = scaled(circuits(60.0), "airspeed0", 2.5, 30.0)
    assert disabled(logic(flight)) != []
    found = logic(with_parameters(flight, **AS_RECORDED))
    assert disabled(found) == []
    assert found["settings"]["ARSPD_OPTIONS"] == {"value": 3.0, "from": "log"}
    assert found["settings"]["ARSPD_WIND_GATE"] == {"value": 5.0, "from": "default"}


def test_what_the_check_writes_into_arspd_use_is_no_setting() -> None:
    flight = with_parameters(scaled(circuits(60.0), "airspeed0", 2.5, 30.0), ARSPD_USE=1.0)
    written = empty_rows("param", 1)
    written["t_us"], written["name"], written["value"] = 37_000_000, b"ARSPD_USE", 0.0
    flight = numbered(flight | {"param": np.concatenate((flight["param"], written))})
    found = logic(flight)
    assert len(disabled(found)) == 1
    assert found["settings"]["ARSPD_USE"]["value"] == 1.0


def test_texts_about_the_sensors_are_kept_and_others_not() -> None:
    rows = empty_rows("text", 4)
    rows["t_us"] = [1_000_000, 2_000_000, 2_000_000, 3_000_000]
    rows["text"] = [
        b"Airspeed sensor 1 failure. Disabling",
        b"EKF3 lane switch 1",
        b"EKF3 lane switch 1",
        b"Mission: 3 WP",
    ]
    rows["severity"] = 3
    tap = BaselineTap()
    tap.step({"text": rows})
    assert tap.summary(500_000)["autopilot_said"] == [
        {"t_s": 0.5, "severity": 3, "text": "Airspeed sensor 1 failure. Disabling"},
        {"t_s": 1.5, "severity": 3, "text": "EKF3 lane switch 1"},
    ]


def test_any_split_of_the_stream_says_the_same() -> None:
    flight = with_parameters(scaled(circuits(60.0), "airspeed0", 2.5, 30.0), ARSPD_WIND_MAX=10.0)
    whole = logic(flight)
    phase = flight.pop("phase")
    batches = [b for b in Batch(flight).split(range(50, 6000, 611)) if len(b)]
    edges = [0, *(max(int(r["t_us"].max()) for r in b.rows.values()) + 1 for b in batches)]
    tap = BaselineTap()
    for (lo, hi), batch in zip(pairwise(edges), batches, strict=True):
        now = phase[(phase["t_us"] >= lo) & (phase["t_us"] < hi)]
        tap.step({**batch.rows, **({"phase": now} if len(now) else {})})
    assert tap.summary(0) == whole


def test_a_pipeline_says_the_same_with_and_without_a_tap() -> None:
    flight = scaled(circuits(60.0), "airspeed0", 2.5, 30.0)
    flight.pop("phase")
    said = []
    for taps in ([], [BaselineTap()]):
        pipeline = Pipeline(Settings(), taps=taps)
        verdicts = pipeline.feed(Batch(flight)).verdicts + pipeline.finish().verdicts
        said.append([repr(v) for v in verdicts])
    assert said[0] == said[1] != []


def test_one_line_for_a_person() -> None:
    nothing: dict[str, Any] = {"ardupilot": [], "px4": []}
    assert one_line(nothing) == "ArduPilot's own logic: nothing; PX4's: nothing"
    entry = {"sensor": "airspeed0", "check": "disabled", "from_s": 162.4, "to_s": 203.1}
    assert "airspeed0 disabled 162.4-203.1 s" in one_line({"ardupilot": [entry], "px4": []})
    many = {"ardupilot": [entry] * 5, "px4": [entry | {"to_s": None}]}
    assert "3 more; PX4's: airspeed0 disabled 162.4-end" in one_line(many)


# --------------------------------------------------------------------------- known holes


def ramped(flight: Flight) -> Flight:
    """A pitot whose reading grows by 10 % a minute, to three times the truth."""
    rows = flight["airspeed0"] = flight["airspeed0"].copy()
    t = rows["t_us"] * 1e-6
    rows["cas_m_s"] *= 1.0 + np.clip((t - 60.0) / 600.0, 0.0, 2.0)
    return flight


def test_a_ramp_of_ten_percent_a_minute_is_found_by_us_and_not_disabled_by_ardupilot() -> None:
    flight = ramped(circuits(1300.0, pitots=1))
    assert disabled(logic(with_parameters(flight, **AS_RECORDED))) == []
    (sensor, t_s), *_ = found_by_us(flight)
    assert sensor == "airspeed0"
    assert 60.0 < t_s < 60.0 + 240.0
    by_default, by_px4 = disabled(logic(flight)), logic(flight)["px4"]
    assert t_s < by_default[0]["from_s"]
    assert t_s < by_px4[0]["from_s"]


def test_on_a_straight_neither_autopilot_ever_sees_that_ramp() -> None:
    found = logic(ramped(circuits(1300.0, pitots=1, straight_s=2000.0)))
    assert found["ardupilot"] == found["px4"] == []


def test_a_fault_that_shows_on_some_headings_toggles_ardupilot_and_not_us() -> None:
    flight = scaled(circuits(1300.0, wind=(7.0, 0.0), straight_s=60.0), "airspeed0", 1.4, 100.0)
    found = logic(with_parameters(flight, ARSPD_OPTIONS=3.0, ARSPD_WIND_MAX=10.0))
    toggles = disabled(found)
    assert len(toggles) >= 4
    assert all(e["to_s"] is not None for e in toggles[:-1])
    assert [sensor for sensor, _ in found_by_us(flight)] == ["airspeed0"]


@pytest.mark.parametrize("pitots", [1, 2])
def test_wind_that_grows_to_18_in_the_climb_fools_both_autopilots_and_not_us(pitots: int) -> None:
    def wind(t: np.ndarray) -> np.ndarray:
        north = -(6.0 + 12.0 * np.clip((t - 10.0) / 6.0, 0.0, 1.0))
        return np.column_stack((north, np.zeros_like(t)))

    flight = circuits(300.0, pitots=pitots, wind=wind, tas=25.0, gust=0.5, straight_s=60.0)
    found = logic(flight)
    assert disabled(found) != []
    assert "airspeed0" in {e["sensor"] for e in found["px4"]}
    assert found_by_us(flight) == []


# --------------------------------------------------------------------------- recorded flights


def recorded(data: Path, name: str) -> dict[str, Any]:
    """What the checks say of a recorded flight, without any watch."""
    log = open_log(data / "sitl" / f"{name}.tlog")
    tap = BaselineTap()
    pipeline = Pipeline(Settings(), watches=[], taps=[tap])
    for batch in log:
        pipeline.feed(batch)
    pipeline.finish()
    return tap.summary(log.info.first_t_us)


def test_the_model_disables_and_enables_when_the_autopilot_did(shared_data: Path) -> None:
    found = recorded(shared_data, "h5_pitot_autotest")
    said = {
        line["text"]: line["t_s"]
        for line in found["autopilot_said"]
        if "failure" in line["text"] or "now OK" in line["text"]
    }
    assert len(said) == 4
    for number in (1, 2):
        (entry,) = disabled(found, f"airspeed{number - 1}")
        assert entry["from_s"] == pytest.approx(
            said[f"Airspeed sensor {number} failure. Disabling"], abs=0.5
        )
        assert entry["to_s"] == pytest.approx(
            said[f"Airspeed sensor {number} now OK. Re-enabled"], abs=0.5
        )


@pytest.mark.parametrize(
    ("name", "switch_s"), [("f5_gyro_bias", 142.6), ("h1_accz5", 150.0), ("n1_calm_nominal", None)]
)
def test_the_model_leaves_a_lane_when_the_autopilot_did(
    shared_data: Path, name: str, switch_s: float | None
) -> None:
    found = recorded(shared_data, name)
    left = [e for e in found["ardupilot"] if e["check"] == "lane left"]
    if switch_s is None:
        assert left == []
    else:
        assert left[0]["sensor"] == "imu0"
        assert left[0]["from_s"] == pytest.approx(switch_s, abs=0.5)
