"""The wing watch on flights of the six-degree-of-freedom vehicle with an autopilot's errors."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from links.airframes import load_airframe
from links.samples import Batch, Rows
from links.vocabulary import Reason, State
from monitor.masks import masks
from monitor.publish import Publisher
from monitor.settings import Settings
from monitor.settings.publish import PublishSettings
from monitor.settings.wing import WingSettings, airframe_of, surfaces_of
from monitor.verdict import PHASE_ROW, StepResult, Verdict
from monitor.watch.wing import WingWatch
from sim_feeds.sixdof import SixDofFlight, WingFault, fly_aerosonde
from tests.monitor.wing_flights import TRAVEL_DEG, TRAVEL_US, rows_of

pytest.importorskip("jsbsim", reason="the vehicle needs the extra sim")

ONSET_S, SEED = 60.0, 71
FAULTS = {
    "healthy": (),
    "right-lift": (WingFault("right.lift", ONSET_S, 10.0),),
    "left-lift": (WingFault("left.lift", ONSET_S, 8.0),),
    "right-drag": (WingFault("right.drag", ONSET_S, 0.0, 0.2),),
}
SENSORS = {"wing_left.lift", "wing_left.drag", "wing_right.lift", "wing_right.drag"}


def settings(airframe: str = "aerosonde", **other: object) -> WingSettings:
    """Of the aircraft's own table, known to 5 %; of any other, the doubt that is the default."""
    known = {"coefficient_share": 0.05} if airframe == "aerosonde" else {}
    return WingSettings.model_validate({"airframe": airframe, **known, **other})


@cache
def flight(case: str, seed: int = SEED) -> SixDofFlight:
    return fly_aerosonde(FAULTS[case], seed=seed, wind_share=0.22, duration_s=130.0)


def rows(case: str) -> dict[str, Rows]:
    out = dict(rows_of(flight(case), seed=SEED).rows)
    return out | {"phase": np.array([(0, 1, True)], PHASE_ROW)}


def run(given: dict[str, Rows], chosen: WingSettings | None = None) -> StepResult:
    return WingWatch(chosen or settings()).step(given, 1 << 62)


def faults(result: StepResult) -> list[Verdict]:
    return [v for v in result.verdicts if v.state is State.FAULTY]


def test_a_healthy_flight_is_judged_and_clean() -> None:
    result = run(rows("healthy"))
    assert not faults(result)
    assert {v.sensor for v in result.verdicts if v.state is State.OK} == SENSORS
    said = [v.reason for v in result.verdicts if v.sensor == "wing_left.lift"]
    assert said == [Reason.ON_GROUND, Reason.LEARNING, None]


@pytest.mark.parametrize(
    ("case", "sensor", "within_s", "size"),
    [("right-lift", "wing_right.lift", 5.0, -10.0), ("left-lift", "wing_left.lift", 10.0, -8.0)],
)
def test_lost_lift_is_found(case: str, sensor: str, within_s: float, size: float) -> None:
    found = faults(run(rows(case)))
    assert {v.sensor for v in found} == {sensor}
    assert 0.0 < found[0].t_us * 1e-6 - ONSET_S <= within_s
    assert found[0].onset_t_us is not None
    assert abs(found[0].onset_t_us * 1e-6 - ONSET_S) < 3.0
    assert size < found[0].magnitude < 0.3 * size
    assert found[0].unit == "%"


def test_the_estimate_comes_to_the_loss() -> None:
    wing = run(rows("right-lift"), settings(coefficient_share=0.15)).estimates["wing"]
    apart = wing["right_lift_percent"] - wing["left_lift_percent"]
    late = wing["t_us"] * 1e-6 > ONSET_S + 20.0
    std = wing["lift_apart_std_percent"][late]
    assert np.median(apart[late]) == pytest.approx(10.0, abs=2.0)
    assert np.mean(np.abs(apart[late] - 10.0) < 2.0 * std) > 0.8
    assert np.median(std) < 2.5
    assert (wing["right_drag_std_percent"] > 20.0).all()  # one wing's drag alone is not observable


def test_growing_drag_is_found() -> None:
    found = faults(run(rows("right-drag")))
    assert {v.sensor for v in found} == {"wing_right.drag"}
    assert 0.2 * (found[0].t_us * 1e-6 - ONSET_S) < 12.0


@pytest.mark.parametrize("seed", [1, 2])
def test_where_the_stream_is_cut_changes_nothing(seed: int) -> None:
    given = rows("left-lift")
    phase = given.pop("phase")
    count = sum(len(r) for r in given.values())
    cuts = np.sort(np.random.default_rng(seed).choice(count, 40, replace=False))
    watch, parts = WingWatch(settings()), []
    for k, piece in enumerate(Batch(given).split(cuts.tolist())):
        until_us = max((int(r["t_us"][-1]) for r in piece.rows.values()), default=0) + 1
        extra = {"phase": phase} if k == 0 else {}
        parts.append(watch.step({**piece.rows, **extra}, until_us))
    whole = run({**given, "phase": phase})
    assert repr([v for p in parts for v in p.verdicts]) == repr(whole.verdicts)
    for name in ("wing", "wing_tests"):
        joined = np.concatenate([p.estimates[name] for p in parts if name in p.estimates])
        assert joined.tobytes() == whole.estimates[name].tobytes()


@pytest.mark.parametrize("case", ["healthy", "left-lift"])
def test_the_ratio_tells_how_near_a_verdict_is(case: str) -> None:
    result = run(rows(case))
    tests, found = result.estimates["wing_tests"], faults(result)
    columns = [tests[name] for name in tests.dtype.names[1:]]
    assert len(tests) > 100
    if not found:
        assert max(c.max() for c in columns) < 1.0
        return
    at = tests[tests["t_us"] == found[0].t_us]["left_lift_ratio"]
    assert at.tolist() == [found[0].statistic / found[0].threshold]
    assert at[0] > 1.0
    assert max(c.max() for c in (columns[0], columns[1], columns[3])) < 1.0


def test_without_an_airframe_it_says_so() -> None:
    result = run(rows("healthy"), WingSettings())
    assert {v.sensor: v.reason for v in result.verdicts} == dict.fromkeys(
        SENSORS, Reason.NO_AIRFRAME
    )
    assert not result.estimates


@pytest.mark.parametrize(
    ("stream", "why"), [("servo", "servo outputs"), ("airspeed0", "airspeed"), ("nav", "velocity")]
)
def test_a_missing_input_is_named(stream: str, why: str) -> None:
    given = rows("healthy")
    del given[stream]
    last = run(given).verdicts[-1]
    assert last.reason is Reason.REFERENCE_MISSING
    assert why in last.evidence


def test_an_input_that_stops_ends_the_judgement() -> None:
    given = rows("right-lift")
    given["servo"] = given["servo"][given["servo"]["t_us"] < 80e6]
    result = run(given)
    assert {v.sensor for v in faults(result)} == {"wing_right.lift"}
    assert result.verdicts[-1].state is State.UNMONITORED
    assert 81.5 <= result.verdicts[-1].t_us * 1e-6 < 84.0


def test_thrust_from_the_throttle_will_do() -> None:
    given = rows("right-lift")
    del given["spool0"]
    assert {v.sensor for v in faults(run(given))} == {"wing_right.lift"}
    chosen = settings(thrust_from="rpm")
    assert run(given, chosen).verdicts[-1].reason is Reason.REFERENCE_MISSING


def test_reversed_servos_and_trims_are_undone() -> None:
    given = rows("left-lift")
    pwm = given["servo"]["pwm_us"].copy()
    pwm[:, 0] = 1530.0 - (pwm[:, 0] - 1500.0)
    given["servo"]["pwm_us"] = pwm
    aileron = {"reversed": True, "trim_us": 1530.0}
    wing = run(given, settings(aileron=aileron)).estimates["wing"]
    plain = run(rows("left-lift")).estimates["wing"]
    np.testing.assert_allclose(wing["left_lift_percent"], plain["left_lift_percent"], atol=1e-6)


def test_a_faulty_accelerometer_is_no_damage() -> None:
    given = rows("healthy")
    given["imu0"]["acc_m_s2"][given["imu0"]["t_us"] > 60e6, 1] += 4.0
    result = run(given)
    assert not faults(result)
    assert result.verdicts[-1].reason is Reason.REFERENCE_NOT_TRUSTED


def test_without_an_imu_lift_is_still_found() -> None:
    given = rows("right-lift")
    del given["imu0"]
    found = faults(run(given))
    lift = next(v for v in found if v.sensor == "wing_right.lift")
    assert 0.0 < lift.t_us * 1e-6 - ONSET_S <= 8.0


def test_a_missing_coefficient_is_named(tmp_path: Path) -> None:
    numbers = load_airframe("aerosonde")
    del numbers["Cmq"]
    path = f"{tmp_path}/mine.toml"
    with open(path, "w", encoding="utf-8") as file:
        file.write("[all]\n" + "\n".join(f"{k} = {v!r}" for k, v in numbers.items()))
    with pytest.raises(ValueError, match="lacks Cmq"):
        settings(path)


def test_deviations_of_the_file_count() -> None:
    known = airframe_of(settings(coefficient_share=0.1))
    assert known.std[0] == 0.0  # mass
    assert max(known.std) == pytest.approx(3.821)  # Cmq
    assert known.learnt_percent == (None,) * 4


def travels(chosen: WingSettings) -> list[tuple[float, float]]:
    return [(one.travel_us, one.travel_deg) for one in surfaces_of(chosen)]


def airframe_file(path: Path, **other: float) -> str:
    numbers = load_airframe("aerosonde") | other
    path.write_text("[all]\n" + "\n".join(f"{k} = {v!r}" for k, v in numbers.items()))
    return str(path)


def test_the_airframe_says_how_far_its_servos_go() -> None:
    assert travels(WingSettings()) == [(400.0, 25.0)] * 3
    assert travels(settings()) == [(TRAVEL_US, pytest.approx(TRAVEL_DEG, abs=1e-3))] * 3
    own = settings(aileron={"travel_deg": 20.0}, rudder={"travel_us": 500.0})
    assert travels(own) == [(400.0, 28.648), (400.0, 20.0), (500.0, 28.648)]


@pytest.mark.parametrize("key", ["Cmq_std", "CL0_std", "healthy_left_drag_percent"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_a_deviation_that_cannot_be_is_named(tmp_path: Path, key: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"mine\.toml: {key} = "):
        settings(airframe_file(tmp_path / "mine.toml", **{key: value}))


def test_a_mass_that_cannot_be_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"mine\.toml: not above zero in the airframe: mass_kg"):
        settings(airframe_file(tmp_path / "mine.toml", mass_kg=0.0))


@pytest.mark.parametrize("key", ["travel_us", "travel_deg"])
@pytest.mark.parametrize("value", [0.0, -5.0, float("nan"), 1001.0])
def test_a_travel_that_cannot_be_is_named(tmp_path: Path, key: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"mine\.toml: {key} = "):
        settings(airframe_file(tmp_path / "mine.toml", **{key: value}))


def test_what_is_published() -> None:
    result = run(rows("right-lift"))
    states = {v.sensor: v.state for v in result.verdicts}
    assert masks(states, {State.FAULTY}) == {"WNG": 0b0100}
    publisher = Publisher(PublishSettings())
    publisher.note(result)
    t_us = int(result.estimates["wing"]["t_us"][-1])
    sent = {
        m.fields["name"]: m.fields["value"]
        for m in publisher.due(0, t_us, silent=False)
        if m.name == "NAMED_VALUE_FLOAT"
    }
    assert sent["FLT_WNG"] == 4.0
    assert {"WL_LIFT", "WL_DRAG", "WR_LIFT", "WR_DRAG"} <= set(sent)
    assert sent["WR_LIFT"] > sent["WL_LIFT"] + 5.0


def test_settings_hold_the_section() -> None:
    assert Settings().wing == WingSettings()
