"""Aircraft of JSBSim as MAVLink vehicles: what they send is what they did."""

import itertools
import sys
from dataclasses import fields

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sim_feeds.player import frames_of, save_truth, truth, truth_table
from sim_feeds.scenario import Flight, ScenarioError, bundled, load, parse, with_aircraft
from sim_feeds.sixdof import consistency

pytest.importorskip("jsbsim", reason="the extra sim is not installed")

AEROSONDE = """
title = "short"
aircraft = "aerosonde"
[circuit]
duration_s = 40.0
[[wind]]
kind = "constant"
speed_m_s = 5.5
toward_deg = 60.0
[[wind]]
kind = "von-karman"
wind_6m_m_s = 5.5
[messages]
servo_hz = 25.0
[rpm]
count = 2
"""
DAMAGE = """
[[fault]]
sensor = "wing_right.lift"
kind = "bias"
start_s = 10.0
size_percent = 10.0
[[fault]]
sensor = "wing_left.drag"
kind = "drift"
start_s = 20.0
rate_percent_per_s = 0.5
"""


def decoded(flight: Flight) -> dict[str, list]:
    out: dict[str, list] = {}
    parser = dialect.MAVLink(None)
    for _, frame in frames_of(flight):
        for message in parser.parse_buffer(frame):
            out.setdefault(message.get_type(), []).append(message)
    return out


def column(messages, *names) -> np.ndarray:
    return np.array([[getattr(m, n) for n in names] for m in messages], dtype=float)


@pytest.fixture(scope="module")
def healthy() -> Flight:
    return parse(AEROSONDE).fly(3)


@pytest.fixture(scope="module")
def hurt() -> Flight:
    return parse(AEROSONDE + DAMAGE).fly(3)


@pytest.fixture(scope="module")
def said(healthy) -> dict[str, list]:
    return decoded(healthy)


def test_it_obeys_its_own_forces_and_rates(healthy):
    found = consistency(healthy.controls)
    assert found.velocity_m_s2.max() < 2e-3
    assert found.attitude_rad_s.max() < 1e-4


def test_it_begins_and_ends_in_the_air_at_its_airspeed_and_height(healthy):
    f, t = healthy.controls, healthy.truth
    assert len(t.t_s) == round(40.0 / 0.005) + 1
    assert t.t_s[0] == 0.0
    assert (t.airborne == 1.0).all()
    np.testing.assert_allclose(t.agl_m, 200.0, atol=8.0)
    np.testing.assert_allclose(f.tas_m_s, 25.0, atol=3.0)


def test_servo_outputs_are_what_the_autopilot_asks(healthy, said):
    f, messages = healthy.controls, said["SERVO_OUTPUT_RAW"]
    assert len(messages) == pytest.approx(40 * 25, abs=2)
    t = column(messages, "time_usec")[:, 0] * 1e-6 - healthy.scenario.start.boot_s
    at = np.clip(np.round(t / 0.005).astype(int), 0, len(f.t_s) - 1)
    pulses = column(messages, *(f"servo{i}_raw" for i in range(1, 5)))
    # A command of 20 ms may have changed by the row next to a stamp.
    for asked, pulse in zip(
        (f.aileron, f.elevator, f.throttle, f.rudder),
        ((pulses - [1500, 1500, 1000, 1500]) / [400, 400, 1000, 400]).T,
        strict=True,
    ):
        near = np.stack([asked[np.clip(at + k, 0, len(asked) - 1)] for k in (-1, 0, 1)])
        assert (np.abs(near - pulse).min(axis=0) < 0.5 / 400 + 1e-9).all()
    assert np.ptp(pulses, axis=0).min() > 20.0
    # By hand, level at 25 m/s: CL = 0.51 takes 0.058 rad; Cm = 0 there needs -0.147 rad of 0.5.
    np.testing.assert_allclose(pulses.mean(axis=0)[[0, 1, 3]], [1500, 1383, 1500], atol=12.0)


def test_surfaces_move_the_way_that_is_said(healthy):
    """A longer pulse rolls right, pitches down, yaws left: roll rate follows the aileron."""
    f = healthy.controls
    p = f.rate_rad_s[:, 0]
    assert np.corrcoef(f.aileron[:-40], p[40:])[0, 1] > 0.5


def test_parameters_say_what_the_outputs_are(said):
    values = {m.param_id: m.param_value for m in said["PARAM_VALUE"]}
    assert [values[f"SERVO{i}_FUNCTION"] for i in (1, 2, 3, 4)] == [4, 19, 70, 21]
    assert [values[f"SERVO{i}_REVERSED"] for i in (1, 2, 3, 4)] == [0, 1, 0, 1]
    assert (values["SERVO3_MIN"], values["SERVO3_MAX"], values["SERVO1_TRIM"]) == (
        1000,
        2000,
        1500,
    )


def test_engine_speed_and_throttle_are_real(healthy, said):
    f, series = healthy.controls, healthy.readings["rpm"]
    rpm = column(said["RPM"], "rpm1", "rpm2")
    np.testing.assert_allclose(rpm, series.values, rtol=1e-6)
    true = np.interp(series.valid_s, f.t_s, f.shaft_rpm[:, 0])
    error = rpm / true[:, None] - 1.0
    assert np.abs(error.mean(axis=0)).max() < 5e-4
    np.testing.assert_allclose(error.std(axis=0), 0.002, rtol=0.2)
    assert 4000.0 < true.min() < true.max() < 6000.0
    hud = column(said["VFR_HUD"], "throttle")
    assert abs(hud.mean() - 100.0 * f.throttle.mean()) < 1.0


def test_everything_else_is_sent_as_ever(said):
    assert set(said) >= {
        "HEARTBEAT", "SYS_STATUS", "EXTENDED_SYS_STATE", "SYSTEM_TIME", "ATTITUDE",
        "ATTITUDE_QUATERNION", "RAW_IMU", "SCALED_IMU2", "GPS_RAW_INT", "GLOBAL_POSITION_INT",
        "SCALED_PRESSURE", "VFR_HUD",
    }  # fmt: skip
    armed = dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert said["HEARTBEAT"][0].base_mode & armed
    above = column(said["GLOBAL_POSITION_INT"], "relative_alt") * 1e-3
    np.testing.assert_allclose(above, 200.0, atol=12.0)
    assert {m.landed_state for m in said["EXTENDED_SYS_STATE"]} == {dialect.MAV_LANDED_STATE_IN_AIR}


def test_wind_is_what_was_asked(healthy):
    wind = healthy.truth.wind_ned_m_s
    expected = 5.5 * np.array([np.cos(np.radians(60.0)), np.sin(np.radians(60.0)), 0.0])
    np.testing.assert_allclose(wind.mean(axis=0), expected, atol=1.2)
    assert 0.3 < wind[:, 2].std() < 1.5


def test_wind_that_changes_is_flown():
    calm = 'title = "x"\naircraft = "aerosonde"\n[circuit]\nduration_s = 12.0\n'
    ramp = '[[wind]]\nkind = "ramp"\nstart_s = 3.0\nend_s = 9.0\neast_m_s = 4.0\n'
    shear = '[[wind]]\nkind = "shear"\nspeed_m_s = 3.0\ntoward_deg = 0.0\n'
    f = parse(calm + ramp + shear).fly(1)
    t, wind = f.truth.t_s, f.truth.wind_ned_m_s
    np.testing.assert_allclose(wind[t < 2.9, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(wind[t > 9.1, 1], 4.0, atol=1e-9)
    assert (np.diff(wind[:, 1]) > -1e-9).all()
    np.testing.assert_allclose(wind[:, 0], 3.0 * (200.0 / 300.0) ** 0.15, rtol=1e-6)


def test_a_damaged_wing_is_flown_from_its_onset_on(healthy, hurt):
    a, b = healthy.controls, hurt.controls
    before = a.t_s < 10.0 - 1e-9
    for f in fields(a):
        if f.name != "damage_percent":
            np.testing.assert_array_equal(getattr(a, f.name)[before], getattr(b, f.name)[before])
    after = slice(int(20.0 / 0.005), None)
    assert b.damage_percent[after, 0].min() == 10.0
    np.testing.assert_allclose(b.damage_percent[-1], [10.0, 0.0, 0.0, 10.0], atol=1e-9)
    assert not a.damage_percent.any()
    # The right wing carries less: the ailerons hold it up.
    assert (b.aileron - a.aileron)[after].mean() < -0.02


def test_the_truth_names_damage_and_holds_controls(hurt, tmp_path):
    entries = truth_table(hurt)["faults"]
    assert [(e["sensor"], e["kind"], e["unit"]) for e in entries] == [
        ("wing_right.lift", "bias", "%"),
        ("wing_left.drag", "drift", "%"),
    ]
    arrays = truth(hurt)
    assert arrays["shaft_rpm"].shape == (len(arrays["t_us"]), 1)
    assert arrays["damage_percent"][-1, 0] == 10.0
    _, file = save_truth(hurt, tmp_path)
    assert set(np.load(file)) == set(arrays)


def test_the_same_seed_gives_the_same_bytes_and_a_sensor_fault_the_same_flight(healthy):
    again = parse(AEROSONDE).fly(3)
    some = slice(0, 3000)
    assert [*itertools.islice(frames_of(again), some.stop)] == [
        *itertools.islice(frames_of(healthy), some.stop)
    ]
    fault = '[[fault]]\nsensor = "spool1"\nkind = "dead"\nstart_s = 10.0\n'
    blind = parse(AEROSONDE + fault).fly(3)
    np.testing.assert_array_equal(blind.controls.euler_rad, healthy.controls.euler_rad)
    rpm = column(decoded(blind)["RPM"], "rpm1", "rpm2")
    t = blind.readings["rpm"].valid_s
    assert (rpm[t >= 10.0, 1] == 0.0).all()
    assert (rpm[t >= 10.0, 0] > 4000.0).all()


def test_a_lost_channel_is_no_message_of_zero():
    fault = '[[fault]]\nsensor = "spool1"\nkind = "dropout"\nstart_s = 10.0\n'
    said = decoded(parse(AEROSONDE.replace("40.0", "15.0") + fault).fly(3))
    assert said["RPM"][-1].rpm2 == -1.0
    three = parse(AEROSONDE.replace("40.0", "15.0").replace("count = 2", "count = 3") + fault)
    speeds = decoded(three.fly(3))
    assert "RPM" not in speeds
    per_index = [sum(m.index == i for m in speeds["RAW_RPM"]) for i in range(3)]
    assert per_index[0] == per_index[2] == pytest.approx(150, abs=2)
    assert per_index[1] == pytest.approx(100, abs=2)


STOP = '[[fault]]\nsensor = "engine0"\nkind = "stop"\nstart_s = 10.0\n'


@pytest.mark.parametrize(
    ("aircraft", "left", "other_runs"),
    [("aerosonde", 0.9, None), ("c172p", 0.6, None), ("A320", 0.9, 2)],
)
def test_an_engine_that_stops(aircraft, left, other_runs):
    """Its shaft slows down, the aircraft loses energy; the other engine runs on."""
    scenario = f'title = "x"\naircraft = "{aircraft}"\n[circuit]\nduration_s = 40.0\n' + STOP
    f = parse(scenario).fly(1).controls
    rpm = f.shaft_rpm
    running, stopped = rpm[f.t_s < 10.0], rpm[f.t_s > 30.0]
    assert stopped[:, 0].max() < left * running[:, 0].min()
    if other_runs is not None:
        assert stopped[:, other_runs].min() > 0.9 * running[:, other_runs].mean()
    else:
        energy = f.height_m + f.tas_m_s**2 / (2.0 * 9.80665)
        lost = np.gradient(energy, f.t_s)
        assert lost[f.t_s > 30.0].mean() < -1.5
        assert abs(lost[f.t_s < 10.0].mean()) < 0.5


@pytest.mark.parametrize(("aircraft", "channels"), [("c172p", 1), ("A320", 4)])
def test_any_aircraft_of_jsbsim_flies_a_scenario_of_another(aircraft, channels):
    """The demo's sensors, wind and first fault on another aircraft, cut to eighty seconds."""

    def shorter(table):
        with_aircraft(table, aircraft)
        assert table["circuit"]["duration_s"] == pytest.approx(load("demo").duration_s, abs=0.1)
        table["circuit"]["duration_s"] = 80.0
        table["fault"] = table["fault"][:1]

    scenario = load("demo", shorter)
    flight = scenario.fly()
    cruise = scenario.cruise()
    np.testing.assert_allclose(flight.controls.tas_m_s, cruise.tas_m_s, rtol=0.12)
    np.testing.assert_allclose(flight.truth.agl_m, cruise.agl_m, atol=30.0)
    bias = flight.faults[0]
    on = flight.readings["imu0"].valid_s >= bias.start_s
    apart = flight.readings["imu0"].values[:, 0] - np.interp(
        flight.readings["imu0"].valid_s, flight.truth.t_s, flight.truth.specific_force_m_s2[:, 0]
    )
    assert apart[on].mean() - apart[~on].mean() == pytest.approx(bias.size, abs=0.1)
    said = decoded(flight)
    if channels == 1:
        assert column(said["RPM"], "rpm2").max() == -1.0
        assert 1500.0 < column(said["RPM"], "rpm1").min()
    else:
        assert {m.index for m in said["RAW_RPM"]} == set(range(channels))
    assert len(said["NAMED_VALUE_FLOAT"]) > 100  # three vanes


@pytest.mark.parametrize(
    ("aircraft", "fault", "says"),
    [
        (
            "c172p",
            'sensor = "wing_left.lift"\nkind = "bias"\nsize_percent = 5.0',
            "c172p cannot be",
        ),
        ("aerosonde", 'sensor = "engine1"\nkind = "stop"', "aerosonde has no engine1"),
        ("c172p", 'sensor = "engine1"\nkind = "stop"', "c172p has no engine1"),
        ("aerosonde", 'sensor = "spool1"\nkind = "dead"', "aerosonde has 1 engine speed"),
    ],
)
def test_what_an_aircraft_does_not_have_cannot_break(aircraft, fault, says):
    text = f'title = "x"\naircraft = "{aircraft}"\n[circuit]\nduration_s = 6.0\n'
    with pytest.raises(ScenarioError, match=says):
        parse(text + f"[[fault]]\nstart_s = 3.0\n{fault}\n").fly()


def test_an_aircraft_that_jsbsim_does_not_have():
    text = 'title = "x"\naircraft = "no-such"\n[start]\nspeed_m_s = 30.0\nagl_m = 300.0\n'
    with pytest.raises(ScenarioError, match="no aircraft 'no-such'"):
        parse(text).fly()


def test_without_jsbsim_one_sentence_and_the_kinematic_vehicle_flies(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    for name in bundled():
        scenario = load(name)  # reading one takes no JSBSim
        if scenario.six_dof:
            with pytest.raises(ScenarioError, match=r"pip install 'mavsentry\[sim\]'") as told:
                scenario.fly()
            assert "\n" not in str(told.value)
    kinematic = AEROSONDE.replace("aerosonde", "small-uav").partition("[circuit]")[0]
    leg = '[start]\nspeed_m_s = 20.0\nagl_m = 100.0\n[[leg]]\ndo = "level"\nduration_s = 5.0\n'
    assert parse(kinematic + leg).fly().controls is None


def test_another_aircraft_does_not_hide_what_is_wrong_in_a_scenario(tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text('title = "x"\naircraft = "small-uav"\n[[leg]]\ndo = "levle"\n')
    with pytest.raises(ScenarioError, match=r"leg\.0.*levle"):
        load(file, lambda table: with_aircraft(table, "c172p"))


def test_the_bundled_aerosonde_scenarios_are_there():
    names = {name.removeprefix("aerosonde-") for name in bundled() if "aerosonde" in name}
    assert names == {
        "healthy", "right-lift", "left-lift", "drag-ramp", "rpm-sensors", "engine-cut"
    }  # fmt: skip
