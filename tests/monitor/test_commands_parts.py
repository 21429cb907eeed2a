"""Parts of the commands that need no process: matching, timing, words on the screen."""

import math
import time

import numpy as np
import pytest

from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.commands.showing import as_json, lines
from monitor.commands.timing import interleaved
from monitor.commands.trial import Trial
from monitor.commands.trial_table import judge
from monitor.verdict import AIR_ESTIMATE, IMU_ESTIMATE, Verdict

S = 1_000_000


def injected(sensor, model="bias", onset_s=50.0, end_s=70.0, **values):
    return {
        "sensor": sensor,
        "kind": model,
        "model": model,
        "onset_s": onset_s,
        "end_s": end_s,
        "onset_t_us": round((onset_s + 20) * S),
        "end_t_us": None if end_s is None else round((end_s + 20) * S),
        "size": 2.0,
        "rate_per_s": 0.0,
        "limit": None,
        "unit": "m/s^2",
        **values,
    }


def found(sensor, detected_s, unit="m/s^2", magnitude=1.9):
    return {
        "sensor": sensor,
        "kind": "bias",
        "onset_s": detected_s - 1.0,
        "detected_s": detected_s,
        "detected_t_us": round((detected_s + 20) * S),
        "magnitude": magnitude,
        "unit": unit,
        "evidence": "",
    }


class FakeAnalysis:
    def __init__(self, faults):
        self.faults = faults


def estimates():
    t_us = np.arange(20 * S, 220 * S, S // 10)
    imu, air = np.zeros(len(t_us), IMU_ESTIMATE), np.zeros(len(t_us), AIR_ESTIMATE)
    imu["t_us"] = air["t_us"] = t_us
    imu["acc_m_s2"][:, 0] = 0.3
    air["cas_m_s"] = 19.5
    return {"imu0": imu, "air": air}


@pytest.fixture
def outcome(tmp_path):
    t_us = np.arange(20 * S, 220 * S, S // 50)
    t_s = t_us / S - 20
    force = np.zeros((len(t_us), 3))
    force[:, 0] = 0.25
    file = tmp_path / "truth.npz"
    np.savez(
        file,
        t_us=t_us,
        specific_force_m_s2=force,
        rate_rad_s=np.zeros_like(force),
        cas_m_s=20.0 + 0.1 * (t_s - 50.0),
        aoa_rad=np.full(len(t_us), 0.05),
    )

    def of(truth_faults, faults):
        trial = Trial({"faults": truth_faults}, FakeAnalysis(faults), [], {}, file, estimates())
        return judge(trial, file)

    return of


def test_a_fault_found_in_time_on_the_right_sensor_is_good(outcome):
    result = outcome([injected("imu0.acc_x")], [found("imu0.acc_x", 51.2)])
    assert result.good
    assert result.sizes == [2.0]
    assert result.values == [(pytest.approx(0.25), pytest.approx(0.3), "m/s^2")]


@pytest.mark.parametrize(
    "verdicts",
    [
        [],
        [found("imu0.acc_y", 51.2)],
        [found("imu0.acc_x", 49.0)],
        [found("imu0.acc_x", 90.0)],
        [found("imu0.acc_x", 51.2), found("imu1.acc_x", 51.2)],
    ],
)
def test_a_missed_early_late_or_further_verdict_is_not_good(outcome, verdicts):
    assert not outcome([injected("imu0.acc_x")], verdicts).good


def test_a_fault_that_is_found_twice_is_one_fault(outcome):
    verdicts = [found("imu0.acc_x", 51.2), found("imu0.acc_x", 65.0)]
    result = outcome([injected("imu0.acc_x")], verdicts)
    assert result.good
    assert result.rows[0][1]["detected_s"] == 51.2


def test_the_error_at_detection_follows_the_fault_model(outcome):
    runaway = injected("airspeed0", "runaway", rate_per_s=-3.0, limit=30.0)
    stuck = injected("airspeed1", "stuck", onset_s=100.0, end_s=None)
    verdicts = [found("airspeed0", 54.0, "m/s"), found("airspeed1", 110.0, "m/s")]
    result = outcome([runaway, stuck], verdicts)
    assert result.sizes[0] == pytest.approx(-12.0)
    assert result.sizes[1] == pytest.approx(-1.0)  # stuck at 25 while the true one goes to 26
    assert result.values[1][:2] == (pytest.approx(26.4), 19.5)


def test_interleaved_times_each_contender_in_turn():
    order = []

    def work(name, seconds):
        def run():
            order.append(name)
            time.sleep(seconds)

        return run

    timings = interleaved({"a": work("a", 0.001), "b": work("b", 0.004)}, budget_s=0.1)
    assert order[:4] == ["a", "b", "a", "b"]
    assert timings["a"].rounds == timings["b"].rounds >= 5
    assert timings["b"].median_us >= 4000 > timings["a"].median_us >= 1000
    assert timings["a"].p99_us >= timings["a"].median_us


def test_a_slow_contender_still_gets_its_rounds():
    calls = []
    interleaved({"slow": lambda: calls.append(time.sleep(0.01))}, budget_s=0.0, rounds_min=3)
    assert len(calls) == 3 + 1


def test_an_imu_that_changes_as_a_whole_is_one_line():
    changes = [Verdict(5 * S, f"imu0.{a}", State.OK) for a in GYRO_ACC_AXES]
    changes.append(Verdict(5 * S, "airspeed0", State.UNMONITORED, Reason.LEARNING))
    assert [" ".join(text.split()) for text in lines(changes)] == [
        "5.00 s airspeed0 unmonitored learning",
        "5.00 s imu0 ok",
    ]


def test_a_fault_is_told_with_size_onset_and_evidence():
    fault = Verdict(
        12 * S,
        "airspeed0",
        State.FAULTY,
        kind=Kind.DRIFT,
        onset_t_us=9 * S,
        magnitude=-3.14,
        unit="m/s",
        evidence="GPS and wind say more",
    )
    (text,) = lines([fault])
    assert " ".join(text.split()) == (
        "12.00 s airspeed0 FAULTY since 9.0 s, 3.1 m/s low, drift: GPS and wind say more"
    )


def test_json_has_words_and_no_nan():
    values = as_json(Verdict(1, "aoa0", State.OK))
    assert values["state"] == "ok"
    assert values["magnitude"] is None
    assert not any(isinstance(v, float) and math.isnan(v) for v in values.values())
