"""docs/ground-stations.md holds the names, bits and expressions that are true of what is sent."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil

from links.logs.tlog import TlogWriter
from links.mavlink import Encoder
from links.vocabulary import GYRO_ACC_AXES, Kind, Reason, State
from monitor.announce import Announcer
from monitor.masks import SENSORS
from monitor.publish import Publisher
from monitor.settings.publish import PublishSettings
from monitor.verdict import (
    AIR_ESTIMATE,
    ENGINE_ESTIMATE,
    IMU_ESTIMATE,
    WING_ESTIMATE,
    StepResult,
    Verdict,
)

S = 1_000_000
DOC = (Path(__file__).parents[2] / "docs" / "ground-stations.md").read_text("utf-8")
BROKEN = ("airspeed1", "imu0.acc_x", "imu0.gyro_y")


def rows_of(heading):
    """Cells of the table whose head begins with this."""
    _, _, rest = DOC.partition(f"| {heading} |")
    table = rest.partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table]


def spelled(cell):
    """``FLT_IMU0`` … ``FLT_IMU4`` is five names; an instance is none."""
    names = re.findall(r"`([^`]+)`", cell)
    if len(names) < 2:
        return names
    stem = names[0].rstrip("0123456789")
    first, last = (int(name.removeprefix(stem)) for name in names)
    return [f"{stem}{i}" for i in range(first, last + 1)]


def estimates(t_us):
    def one(dtype, **values):
        rows = np.ones(1, dtype)
        rows["t_us"] = t_us
        for name, value in values.items():
            rows[name] = value
        return rows

    return {
        "air": one(AIR_ESTIMATE, cas_m_s=24.0, aoa_rad=math.radians(4), wind_ned_m_s=(3, 4, 0)),
        "engine": one(ENGINE_ESTIMATE),
        "wing": one(WING_ESTIMATE),
        **{f"imu{i}": one(IMU_ESTIMATE) for i in range(5)},
    }


def published(t_us=100 * S, **choices):
    """All that goes out when everything is watched, some of it is broken, and all is chosen."""
    publisher = Publisher(PublishSettings(**choices))
    sensors = [sensor for bits in SENSORS.values() for sensor in bits.values()]
    verdicts = [
        Verdict(t_us, s, State.FAULTY if s in BROKEN else State.OK, magnitude=1.0, unit="m/s")
        for s in [*sensors, "engine0"]
    ]
    publisher.note(StepResult(verdicts, estimates(t_us)))
    return publisher.due(0, t_us, silent=False)


def test_the_table_has_every_message_and_name_and_no_other():
    sent = [
        m for choice in ("HIGHRES_IMU", "SCALED_IMU") for m in published(imu_reconstructed=choice)
    ]
    messages = {re.sub(r"IMU\d$", "IMU", m.name) for m in sent}
    named = {m.fields["name"] for m in sent if "name" in m.fields}
    table = rows_of("message | name | unit")
    assert {row[0] for row in table} == messages
    told = [name for row in table for name in spelled(row[1])]
    assert len(told) == len(set(told))
    assert set(told) == named
    for row in table:
        ids = {m.fields["id"] for m in sent if m.name == row[0] and "id" in m.fields}
        if ids:
            first, last = min(ids), max(ids)
            assert row[1] == (f"id {first}" if first == last else f"id {first} … {last}")


def test_the_bits_are_those_of_the_masks():
    told = {}
    for masks, bits in rows_of("mask | bit: sensor"):
        for mask in spelled(masks):
            told[mask] = dict(re.findall(r"(\d+): ([\w.]+)", bits))
    for mask, sensors in SENSORS.items():
        if mask == "ENG":
            assert sensors == {i: f"spool{i}" for i in range(24)}
            continue
        words = {str(bit): s.partition(".")[2] if "imu" in s else s for bit, s in sensors.items()}
        assert told[mask] == words
    assert set(told) == set(SENSORS)


def test_the_examples_of_masks_are_true():
    values = {m.fields["name"]: m.fields["value"] for m in published() if "value" in m.fields}
    assert "`FLT_AIR` = 2 says that airspeed1 is faulty" in DOC
    assert values["FLT_AIR"] == 2
    assert "`FLT_IMU0` = 17 that imu0.acc_x and imu0.gyro_y are" in DOC
    assert values["FLT_IMU0"] == 17


def fault(sensor, unit="m/s", magnitude=-3.1, onset_s=88, state=State.FAULTY, **values):
    return Verdict(
        99 * S,
        sensor,
        state,
        onset_t_us=onset_s * S,
        magnitude=magnitude,
        unit=unit,
        kind=Kind.BIAS,
        **values,
    )


def test_the_texts_are_those_that_are_sent():
    def said(*verdicts, burst=4):
        announcer = Announcer(burst, 2.0)
        for verdict in verdicts:
            announcer.note(verdict)
        return [text.text for text in announcer.due(0, 100 * S)]

    ok = [
        Verdict(99 * S, s, State.OK)
        for s in ("airspeed0", *(f"imu{i}.{axis}" for i in range(2) for axis in GYRO_ACC_AXES))
    ]
    pair = [
        Verdict(99 * S, f"imu{i}.gyro_x", State.SUSPECT, Reason.SENSORS_DISAGREE) for i in range(2)
    ]
    sent = [
        *said(fault("airspeed0")),
        *said(fault("imu0.acc_x"), fault("imu0.gyro_y"), fault("airspeed0"), burst=1),
        *said(Verdict(99 * S, "airspeed1", State.STALE)),
        *said(*pair),
        *said(fault("engine0", state=State.STOPPED, onset_s=97)),
        *said(*ok),
    ]
    told = [re.findall(r"`([^`]+)`", row[0])[0] for row in rows_of("text | says")]
    assert [sorted(text.split()) for text in sent] == [sorted(text.split()) for text in told]


# -- Expressions --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Messages of a recording as pymavlink keeps them for expressions."""
    log = tmp_path_factory.mktemp("published") / "published.tlog"
    ours, autopilot = Encoder(1, 191), Encoder(1, 1)
    heard = {
        "HEARTBEAT": {
            "type": 1,
            "autopilot": 3,
            "base_mode": 0,
            "custom_mode": 0,
            "system_status": 4,
            "mavlink_version": 3,
        },
        "VFR_HUD": {
            "airspeed": 20.0,
            "groundspeed": 20.0,
            "heading": 0,
            "throttle": 50,
            "alt": 1.0,
            "climb": 0.0,
        },
    }
    frames = [autopilot.encode(name, **fields) for name, fields in heard.items()]
    sent = published(imu_reconstructed="HIGHRES_IMU")
    with TlogWriter(log) as writer:
        for frame in [*frames, *(ours.encode(m.name, **m.fields) for m in sent)]:
            writer.write(frame, 1_700_000_000 * S)
    reader = mavutil.mavlink_connection(str(log), dialect="ardupilotmega")
    while reader.recv_match() is not None:
        pass
    reader.close()
    return reader.messages


def expressions():
    lines = re.findall(r"^graph (.+)$", DOC, re.MULTILINE)
    return [expression for line in lines for expression in line.split()]


@pytest.mark.parametrize("expression", expressions())
def test_every_expression_has_a_value_on_a_recording(messages, expression):
    value = mavutil.evaluate_expression(expression, messages)
    assert isinstance(value, int | float), expression
    assert math.isfinite(value)


def test_expressions_give_what_was_sent(messages):
    def value(expression):
        assert expression in DOC
        return mavutil.evaluate_expression(expression, messages)

    assert len(expressions()) >= 15
    assert value("NAMED_VALUE_FLOAT['R_CAS'].value") == 24.0
    assert value("AOA_SSA.AOA") == pytest.approx(4.0)
    assert value("hypot(WIND_COV.wind_x,WIND_COV.wind_y)") == pytest.approx(5.0)
    assert value("(int(NAMED_VALUE_FLOAT['FLT_AIR'].value)>>1)&1") == 1
    assert value("(int(NAMED_VALUE_FLOAT['FLT_IMU0'].value)>>4)&1") == 1
