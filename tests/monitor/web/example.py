"""Messages as a daemon in flight would send them: three minutes in which the pitot is blocked.

    for message in messages():          # hello, history, frames; no clock, the same every time

Airspeed0 reads low from 60 s on, is suspected at 66 s and named at 70 s; imu1 stops at 120 s; the
link is silent for the last four seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, sin

from monitor.web.protocol import (
    PROTOCOL,
    Air,
    Fault,
    Frame,
    Hello,
    History,
    Imu,
    Link,
    Message,
    Standing,
)

RATE_HZ = 5.0
HISTORY_S = 300.0
STARTED_UNIX_S = 1_760_000_000.0
BLOCKED_S, SUSPECT_S, FAULTY_S, STALE_S, SILENT_S, END_S = 60.0, 66.0, 70.0, 120.0, 176.0, 180.0
AXES = ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
CHANNELS = {
    **{f"imu{i}.{axis}": "m/s²" if axis[:3] == "acc" else "deg/s" for i in (0, 1) for axis in AXES},
    "airspeed0": "m/s",
    "aoa0": "deg",
    "spool0": "rpm",
    "gps0.speed": "m/s",
    "altitude": "m",
    "roll": "deg",
    "pitch": "deg",
}


def messages(history_to_s: float = 30.0) -> Iterator[Message]:
    """Hello, history and frames of the whole flight, as a viewer who comes at that time hears."""
    frames = list(all_frames())
    before = [frame for frame in frames if frame["t_s"] <= history_to_s]
    yield hello(before)
    half = len(before) // 2
    yield History(kind="history", last=False, frames=before[:half])
    yield History(kind="history", last=True, frames=before[half:])
    yield from frames[len(before) :]


def hello(before: list[Frame]) -> Hello:
    """What stands after these frames."""
    timeline: dict[str, list[Standing]] = {}
    for frame in before:
        for sensor, changes in frame.get("changes", {}).items():
            timeline.setdefault(sensor, []).extend(changes)
    faults = [fault for frame in before for fault in frame.get("faults", ())]
    seldom = {}
    for key in ("streams", "latency", "recorder", "process", "rejected", "channels"):
        found = [frame[key] for frame in before if key in frame]
        if found:
            seldom[key] = found[-1]
    return Hello(
        kind="hello",
        protocol=PROTOCOL,
        run="example",
        source="udpin:127.0.0.1:14550",
        profile="transport",
        version="0.1.0",
        started_unix_s=STARTED_UNIX_S,
        rate_hz=RATE_HZ,
        history_s=HISTORY_S,
        number=before[-1]["number"] if before else -1,
        t_s=before[-1]["t_s"] if before else None,
        flying=before[-1]["flying"] if before else False,
        link=before[-1]["link"] if before else None,
        timeline=timeline,
        faults=faults,
        events=[],
        **seldom,
    )


def all_frames() -> Iterator[Frame]:
    """Every frame of the example."""
    told = {0.0: started(), 5.0: flying(), SUSPECT_S: suspected(), FAULTY_S: blocked()}
    told[STALE_S] = stopped()
    for number in range(int(END_S * RATE_HZ) + 1):
        host_s = number / RATE_HZ
        t_s = min(host_s, SILENT_S)
        frame = Frame(
            kind="frame",
            number=number,
            unix_s=STARTED_UNIX_S + host_s,
            t_s=t_s,
            flying=t_s >= 5.0,
            link=link(host_s),
        )
        if host_s in told:
            frame["changes"] = told[host_s]
        if host_s == FAULTY_S:
            frame["faults"] = [pitot_fault()]
        if number == 0:
            frame["channels"] = CHANNELS
        if number % 5 == 0:
            frame |= seldom(host_s)
        if host_s <= SILENT_S:
            frame |= values(t_s)
        yield frame


def values(t_s: float) -> dict[str, object]:
    """Measurements, tests and estimates of one frame."""
    cas = 100.0 + 3.0 * sin(t_s / 9.0)
    seen = cas - (0.5 * (t_s - BLOCKED_S) if t_s > BLOCKED_S else 0.0)
    ratio = 0.3 + 0.1 * sin(t_s) + (max(0.0, t_s - BLOCKED_S) / 8.0)
    measured = {
        "airspeed0": (seen - 0.4, seen + 0.5),
        "aoa0": (2.0 + sin(t_s / 5.0), 2.1 + sin(t_s / 5.0)),
        "spool0": (8200.0, 8203.0),
        "gps0.speed": (cas + 8.0, cas + 8.1),
        "altitude": (1000.0 + 2.0 * t_s, 1000.0 + 2.0 * t_s),
        "roll": (5.0 * sin(t_s / 7.0), 5.2 * sin(t_s / 7.0) + 0.2),
        "pitch": (1.9, 2.3),
    }
    for i in (0, 1) if t_s < STALE_S else (0,):
        for k, axis in enumerate(AXES):
            middle = -9.8 if axis == "acc_z" else 0.3 * sin(t_s / (3.0 + k))
            measured[f"imu{i}.{axis}"] = (middle - 0.2, middle + 0.2)
    return {
        "measured": measured,
        "tests": {"airspeed0": ratio, "imu0.acc_x": 0.2 + 0.1 * cos(t_s), "imu0.gyro_z": 0.1},
        "expected": {"airspeed0": [cas + 0.2, 0.8]},
        "air": Air(
            t_s=t_s,
            cas_m_s=cas,
            cas_std_m_s=0.8,
            tas_m_s=1.06 * cas,
            tas_std_m_s=0.9,
            aoa_deg=2.0 + sin(t_s / 5.0),
            aoa_std_deg=0.4,
            ssa_deg=None,
            ssa_std_deg=None,
            wind_ned_m_s=[4.0, -2.0 + 0.2 * sin(t_s / 30.0), 0.0],
            wind_std_ned_m_s=[0.5, 0.5, 1.0],
        ),
        "imu": {
            "imu0": Imu(
                t_s=t_s,
                acc_fault_m_s2=[0.01 * sin(t_s), 0.0, 0.0],
                acc_fault_std_m_s2=[0.05, 0.05, 0.05],
                gyro_fault_deg_s=[0.0, 0.0, 0.02 * cos(t_s)],
                gyro_fault_std_deg_s=[0.05, 0.05, 0.05],
            )
        },
    }


def link(host_s: float) -> Link:
    silent = host_s > SILENT_S
    heard_s = min(host_s, SILENT_S)
    return Link(
        silent=host_s > SILENT_S + 3.0,
        silent_s=host_s - heard_s,
        datagrams=int(500 * heard_s),
        datagrams_s=0.0 if silent else 500.0,
        rows_s=0.0 if silent else 640.0,
        bytes=int(40_000 * heard_s),
        bad_bytes=12,
        lost=3,
        sent=int(30 * host_s),
    )


def seldom(host_s: float) -> dict[str, object]:
    heard_s = min(host_s, SILENT_S)
    rates = {"imu0": 200.0, "imu1": 200.0, "airspeed0": 10.0, "gps0": 5.0, "attitude": 50.0}
    return {
        "streams": {
            name: {
                "rate_hz": 0.0 if name == "imu1" and host_s > STALE_S else rate,
                "samples": int(rate * heard_s),
                "gaps": 0,
                "stale": name == "imu1" and host_s > STALE_S,
            }
            for name, rate in rates.items()
        },
        "latency": {
            "count": int(12 * host_s),
            "median_ms": 21.0,
            "p99_ms": 24.5,
            "worst_ms": 31.0,
        },
        "recorder": {
            "file": "mavsentry-20251009T085320Z-000.tlog",
            "file_bytes": int(40_000 * heard_s),
            "bytes": int(40_000 * heard_s),
            "stopped": None,
        },
        "process": {"cpu_s": 0.2 * host_s, "memory_mb": 180.0, "snapshot_ms": 0.4, "dropped": 0},
        "rejected": {"frame": {"bad crc": 2, "garbage bytes": 1}, "gps0": {"duplicate": 4}},
    }


def standing(t_s: float, state: str, **more: object) -> Standing:
    blank = {"reason": None, "kind": None, "size": None, "onset_t_s": None, "evidence": ""}
    return Standing(t_s=t_s, state=state, **(blank | more))


def started() -> dict[str, list[Standing]]:
    sensors = [f"imu{i}.{axis}" for i in (0, 1) for axis in AXES] + ["airspeed0", "aoa0", "spool0"]
    return {s: [standing(0.0, "unmonitored", reason="on ground")] for s in sensors} | {
        "gps0": [standing(0.0, "ok")],
        "attitude": [standing(0.0, "ok")],
        "imu2": [standing(0.0, "absent", evidence="imu2 shows nothing: it is not fitted")],
    }


def flying() -> dict[str, list[Standing]]:
    sensors = [s for s in started() if s not in ("gps0", "attitude", "imu2", "spool0")]
    no_model = "no engine model (mavsentry learn engine)"
    return {s: [standing(5.0, "ok")] for s in sensors} | {
        "spool0": [standing(5.0, "unmonitored", reason=no_model)]
    }


def suspected() -> dict[str, list[Standing]]:
    return {"airspeed0": [standing(SUSPECT_S, "suspect", evidence="reads low against the wind")]}


def blocked() -> dict[str, list[Standing]]:
    fault = pitot_fault()
    shown = {key: fault[key] for key in ("kind", "size", "onset_t_s", "evidence")}
    return {"airspeed0": [standing(FAULTY_S, "faulty", **shown)]}


def stopped() -> dict[str, list[Standing]]:
    said = "imu1 sends no data any more"
    return {f"imu1.{axis}": [standing(STALE_S, "stale", evidence=said)] for axis in AXES}


def pitot_fault() -> Fault:
    return Fault(
        number=0,
        sensor="airspeed0",
        kind="drift",
        size="5.0 m/s low",
        onset_t_s=BLOCKED_S + 1.2,
        detected_t_s=SUSPECT_S,
        isolated_t_s=FAULTY_S,
        cleared_t_s=None,
        magnitude=-5.0,
        unit="m/s",
        statistic=31.2,
        threshold=25.0,
        estimator="air_data_2d",
        evidence="airspeed0 reads 5.0 m/s less than ground speed and wind say",
    )
