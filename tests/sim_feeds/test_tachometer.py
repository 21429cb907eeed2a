"""Engine-speed sensors: what they read, how they break, and which shaft they belong to."""

import numpy as np
import pytest

from sim_feeds.fault_table import FaultEntry
from sim_feeds.faults import Fault, FaultKind
from sim_feeds.scenario import parse
from sim_feeds.section import ScenarioError
from sim_feeds.tachometer import Tachometer

T = np.arange(0.0, 60.0, 0.005)
SPEEDS = np.column_stack([5000.0 + 500.0 * np.sin(0.3 * T), 9000.0 - 20.0 * T])


def read(faults=(), **how):
    how = {"noise_share": 0.0, "quantum_rpm": 0.0} | how
    return Tachometer(**how).read(T, SPEEDS, list(faults), seed=2)


def test_each_shaft_has_its_sensors():
    s = read(count=2)
    assert Tachometer(count=2).channels(2) == [0, 0, 1, 1]
    for channel, shaft in enumerate([0, 0, 1, 1]):
        expected = np.interp(s.valid_s, T, SPEEDS[:, shaft])
        np.testing.assert_array_equal(s.values[:, channel], expected)
    assert len(s.valid_s) == pytest.approx(600, abs=2)
    assert (s.sent_s >= s.valid_s).all()


def test_noise_is_a_share_of_the_reading_and_each_sensors_own():
    s = read(count=2, noise_share=0.01, rate_hz=50.0)
    error = s.values / np.column_stack([np.interp(s.valid_s, T, x) for x in SPEEDS.T[[0, 0, 1, 1]]])
    np.testing.assert_allclose(error.std(axis=0), 0.01, rtol=0.06)
    assert abs(np.corrcoef(error[:, 0], error[:, 1])[0, 1]) < 0.06


def test_faults_of_one_channel_leave_the_others():
    faults = [
        Fault("spool0", FaultKind.DEAD, 10.0, 20.0),
        Fault("spool1", FaultKind.STUCK, 10.0),
        Fault("spool2", FaultKind.DROPOUT, 10.0, 20.0),
        Fault("imu0.acc_x", FaultKind.BIAS, 0.0, size=1.0),
    ]
    well, hurt = read(count=2).values, read(faults, count=2).values
    t = read(count=2).valid_s
    on = (t >= 10.0) & (t < 20.0)
    assert (hurt[on, 0] == 0.0).all()
    assert (hurt[t >= 10.0, 1] == well[t < 10.0, 1][-1]).all()
    assert np.isnan(hurt[on, 2]).all()
    np.testing.assert_array_equal(hurt[:, 3], well[:, 3])
    np.testing.assert_array_equal(hurt[~on][:, [0, 2]], well[~on][:, [0, 2]])


def test_intermittent_readings_are_uniform_below_the_speed():
    s = read([Fault("spool0", FaultKind.INTERMITTENT, 0.0, size=0.2)], rate_hz=50.0)
    share = s.values[:, 0] / np.interp(s.valid_s, T, SPEEDS[:, 0])
    lost = share < 1.0
    assert lost.mean() == pytest.approx(0.2, abs=0.025)
    np.testing.assert_allclose(
        np.quantile(share[lost], [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.07
    )


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"sensor": "spool0", "kind": "intermittent"}, "fraction between 0 and 1"),
        ({"sensor": "spool0", "kind": "intermittent", "fraction": 1.0}, "fraction between"),
        ({"sensor": "imu0.acc_x", "kind": "intermittent", "fraction": 0.2}, "engine-speed sensor"),
        ({"sensor": "wing_left.lift", "kind": "stuck"}, "a bias or a drift, in percent"),
        ({"sensor": "wing_left.lift", "kind": "bias"}, "needs size_percent"),
        ({"sensor": "wing_left.lift", "kind": "bias", "size_rpm": 3.0}, "units are percent"),
        ({"sensor": "wing_left.side", "kind": "bias", "size_percent": 3.0}, "is no sensor"),
        ({"sensor": "engine0", "kind": "dead"}, "can only stop"),
        ({"sensor": "spool0", "kind": "stop"}, "only an engine does"),
        ({"sensor": "engine0", "kind": "stop", "end_s": 9.0}, "no end_s"),
    ],
)  # fmt: skip
def test_a_wrong_entry_says_what_fits(entry, says):
    with pytest.raises(ValueError, match=says):
        FaultEntry(**{"start_s": 1.0} | entry)


def test_a_wing_is_damaged_in_percent():
    entry = FaultEntry(
        sensor="wing_right.drag", kind="drift", start_s=5.0, rate_percent_per_s=0.2,
        limit_percent=3.0,
    )  # fmt: skip
    grown = entry.fault().disturb(np.array([4.9, 10.0, 90.0]), np.zeros(3), 0.0)
    np.testing.assert_allclose(grown, [0.0, 1.0, 3.0])


KINEMATIC = """
title = "x"
aircraft = "small-uav"
[start]
speed_m_s = 20.0
agl_m = 100.0
[[leg]]
do = "level"
duration_s = 9.0
"""
CIRCUIT = 'title = "x"\naircraft = "aerosonde"\n[circuit]\nduration_s = 20.0\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            KINEMATIC + '[[fault]]\nsensor = "spool0"\nkind = "dead"\nstart_s = 1.0\n',
            "spool0 breaks on an aircraft with six degrees of freedom only",
        ),
        (KINEMATIC + "[circuit]\nduration_s = 20.0\n", "small-uav does not fly circuit"),
        (KINEMATIC.replace("small-uav", "c172p"), "c172p does not fly leg"),
        (CIRCUIT.replace("aerosonde", "areosonde"), "no aircraft 'areosonde' is known"),
        (CIRCUIT + "waypoints_m = [[0.0, 0.0], [9.0, 0.0]]\n", "needs three waypoints"),
        (CIRCUIT + "[start]\ntemperature_offset_k = 9.0\n", "in the standard atmosphere"),
        (
            CIRCUIT + '[[fault]]\nsensor = "engine0"\nkind = "stop"\nstart_s = 25.0\n',
            "the flight of this aerosonde ends at 20 s",
        ),
    ],
)
def test_each_aircraft_has_what_it_flies(text, says):
    with pytest.raises(ScenarioError, match=says):
        parse(text)
