"""Scenario files: bundled ones load and fly, errors help, seeds decide every bit."""

import hashlib
import itertools

import numpy as np
import pytest

from sim_feeds.faults import FaultKind
from sim_feeds.scenario import ScenarioError, bundled, load, parse

MINIMAL = """
title = "x"
aircraft = "small-uav"
[start]
speed_m_s = 20.0
agl_m = 100.0
[[leg]]
do = "level"
duration_s = 4.0
"""


def test_the_bundled_scenarios_are_there():
    assert set(bundled()) >= {
        "demo",
        "transport-healthy",
        "transport-cas-runaway",
        "small-uav-healthy",
        "small-uav-pitot-blockage",
        "small-uav-imu-bias",
        "light-aircraft-vane",
        "parked",
        "lu2016-table2",
        "wan2016-two-of-three",
        "aerosonde-healthy",
    }


@pytest.mark.parametrize("name", bundled())
def test_bundled_scenarios_make_sense(name):
    scenario = load(name)
    assert 60.0 < scenario.duration_s < 500.0
    for fault in scenario.fault:
        assert fault.start_s < scenario.duration_s - 10.0, "time enough to be found"
    if "healthy" in name or name == "parked":
        assert not scenario.fault
    elif name != "parked":
        assert scenario.fault


def test_the_demo_is_short_and_rich():
    demo = load("demo")
    assert 150.0 <= demo.duration_s <= 170.0
    assert (demo.airspeed.count, demo.aoa.count, demo.imu.count) == (3, 3, 2)
    assert len({f.sensor.split(".")[0][:-1] for f in demo.fault}) == 3
    ordered = sorted(demo.fault, key=lambda f: f.start_s)
    for first, second in itertools.pairwise(ordered):
        assert first.end_s is not None
        assert second.start_s - first.end_s >= 5.0, "time to recover"


def test_defaults_fly():
    flight = parse(MINIMAL).fly()
    assert set(flight.readings) == {"imu0", "imu1", "airspeed0", "baro0", "gps0"}
    assert flight.truth.t_s[-1] == pytest.approx(4.0)


def digest(text: str, seed: int) -> str:
    flight = parse(text).fly(seed)
    parts = [flight.readings[k].values.tobytes() for k in sorted(flight.readings)]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_a_seed_decides_every_bit():
    assert digest(MINIMAL, 1) == digest(MINIMAL, 1)
    assert digest(MINIMAL, 1) != digest(MINIMAL, 2)


def test_another_sensor_leaves_the_others_alone():
    one, two = parse(MINIMAL).fly(), parse(MINIMAL + "[airspeed]\ncount = 2\n").fly()
    for name in one.readings:
        np.testing.assert_array_equal(one.readings[name].values, two.readings[name].values)


def fault(line: str) -> str:
    return f"{MINIMAL}[[fault]]\n{line}\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("title = ", "no TOML"),
        (
            MINIMAL.replace("small-uav", "glider"),
            "glider does not fly leg: the kinematic transport",
        ),
        (MINIMAL + "[imu]\ncuont = 1\n", "imu.cuont: unknown key; did you mean 'count'"),
        (MINIMAL.replace("duration_s", "duration"), "did you mean 'duration_s'"),
        (MINIMAL.replace("level", "loop"), "do not|does not match"),
        (MINIMAL + '[[leg]]\ndo = "take-off"\n', "already flying"),
        (MINIMAL + '[[wind]]\nkind = "constant"\nspeed_m_s = 3.0\nfrom_deg = 2.0\n', "toward_deg"),
        (fault('sensor = "imu0.acc_w"\nkind = "bias"\nstart_s = 1.0'), "no sensor"),
        (fault('sensor = "imu0"\nkind = "bias"\nstart_s = 1.0'), "name one of its axes"),
        (fault('sensor = "imu0.acc_x"\nkind = "bias"\nstart_s = 1.0'), "needs size_m_s2"),
        (
            fault('sensor = "airspeed0"\nkind = "bias"\nstart_s = 1.0\nsize_deg = 2.0'),
            "does not fit airspeed0: its units are m_s, kt",
        ),
        (
            fault('sensor = "airspeed0"\nkind = "runaway"\nstart_s = 1.0'),
            "rate_m_s_per_s or rate_kt",
        ),
        (fault('sensor = "airspeed0"\nkind = "scale"\nstart_s = 1.0'), "needs fraction"),
        (fault('sensor = "aoa0"\nkind = "stuck"\nstart_s = 1.0'), "has 0 aoa sensor"),
        (fault('sensor = "airspeed0"\nkind = "dead"\nstart_s = 3.0\nend_s = 2.0'), "not after"),
        (fault('sensor = "gps0"\nkind = "pitot-blocked"\nstart_s = 3.0'), "only drop out"),
        (
            fault('sensor = "baro0"\nkind = "pitot-blocked"\nstart_s = 3.0'),
            "airspeed sensor's tubes",
        ),
        (fault('sensor = "imu0"\nkind = "outage"\nstart_s = 3.0'), "fault of gps0"),
        (fault('sensor = "airspeed0"\nkind = "dead"\nstart_s = 9.0'), "small-uav ends at 4 s"),
        (MINIMAL + "[autopilot]\nattitude_follows_imu = 2\n", "imu.count = 2"),
        (MINIMAL + "[imu]\ncount = 4\n", "highres"),
    ],
)
def test_errors_help(text, says):
    with pytest.raises(ScenarioError, match=says):
        parse(text)


def test_missing_scenarios(tmp_path):
    with pytest.raises(ScenarioError, match="did you mean 'demo'"):
        load("demmo")
    with pytest.raises(ScenarioError, match="cannot read"):
        load(tmp_path / "none.toml")


def test_units_of_faults():
    text = MINIMAL + "[aoa]\ncount = 1\n"
    text += '[[fault]]\nsensor = "aoa0"\nkind = "bias"\nstart_s = 1.0\nsize_deg = 9.0\n'
    text += (
        '[[fault]]\nsensor = "airspeed0"\nkind = "runaway"\nstart_s = 1.0\nrate_kt_per_s = -15.0\n'
    )
    text += (
        '[[fault]]\nsensor = "airspeed0"\nkind = "icing"\nstart_s = 2.0\nfraction_per_s = 0.02\n'
    )
    bias, runaway, icing = parse(text).faults()
    assert bias.size == pytest.approx(np.radians(9.0))
    assert runaway.rate == pytest.approx(-15.0 * 0.514444)
    assert icing.kind is FaultKind.ICING
    assert icing.rate == 0.02


def test_override_changes_the_table():
    scenario = load("demo", lambda table: table.update(fault=[]))
    assert not scenario.fault
