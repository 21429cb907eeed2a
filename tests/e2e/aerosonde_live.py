"""What the daemon finds on the Aerosonde over UDP, all four monitors at work.

    python -m tests.e2e.aerosonde_live [--out DIR] [--seeds 10] [--speed 1] [--jobs 2]

Every flight is flown by ``mavsentry feed`` into a daemon of its own over UDP loopback, engine and
airframe as a user would have them: the engine learnt from three healthy flights of other seeds, the
airframe's table as bundled; three engine-speed sensors. Wind of 20 to 25 % of the airspeed, its
direction another for each seed.
Then the same healthy flights, and flights with damage, as logs with coefficients that are 15 % off,
and once more with those learnt from three healthy flights.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from estimators.wing_model import AERODYNAMIC
from links.airframes import load_airframe
from monitor.commands.daemon_process import DaemonProcess
from monitor.toml import toml_value

COMMAND = (sys.executable, "-m", "monitor.cli")
AIRSPEED_M_S = 25.0
HEALTHY = "aerosonde-healthy"
LEARN_FROM = (7001, 7002, 7003)
WRONG_SHARE, KNOWN_SHARE = 0.15, 0.05
N_MODELS = 3
READY_S = 180.0
DRAG = "aerosonde-drag-ramp"
RPM = "aerosonde-rpm-sensors"
BROKEN = ("aerosonde-right-lift", "aerosonde-left-lift", "left-lift-5", DRAG)
ALARMS = ("faulty", "stopped")


@dataclass(frozen=True, slots=True)
class Alarm:
    """A sensor found faulty, or an engine stopped, seconds of vehicle time since the boot."""

    sensor: str
    state: str
    t_s: float


@dataclass(frozen=True, slots=True)
class Case:
    """One flight: its scenario file, and the folder that its truth goes to."""

    name: str
    seed: int
    scenario: Path
    truth: Path


def case(folder: Path, name: str, seed: int) -> Case:
    """The bundled scenario ``name`` with the wind of this seed, written to ``folder``."""
    bundled = "aerosonde-left-lift" if name == "left-lift-5" else name
    table = tomllib.loads(files("sim_feeds").joinpath(f"scenarios/{bundled}.toml").read_text())
    rng = np.random.default_rng([seed, 5])
    wind_m_s = AIRSPEED_M_S * rng.uniform(0.20, 0.25)
    for wind in table["wind"]:
        if wind["kind"] == "constant":
            wind |= {"speed_m_s": wind_m_s, "toward_deg": rng.uniform(0.0, 360.0)}
        else:
            wind |= {"wind_6m_m_s": wind_m_s}
    if name == "left-lift-5":
        table["fault"][0]["size_percent"] = 5.0
    file = folder / f"{name}-{seed}.toml"
    table |= {"seed": seed, "rpm": {"count": 3}}
    lines = (f"{key} = {toml_value(value)}" for key, value in table.items())
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Case(name, seed, file, folder / f"{name}-{seed}")


def mavsentry(*arguments: object) -> str:
    """What the command prints.

    Raises
    ------
    subprocess.CalledProcessError
        It ended with anything but 0.
    """
    words = [*COMMAND, *map(str, arguments)]
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def flown_live(flight: Case, config: Path, speed: float) -> list[Alarm]:
    """Alarms of a daemon that the flight is fed to over UDP; what it publishes is kept."""
    flight.truth.mkdir(exist_ok=True)
    out = flight.truth / "published.tlog"
    out.unlink(missing_ok=True)
    with DaemonProcess(("--config", str(config), "--out", str(out))) as daemon:
        until_s = time.monotonic() + READY_S
        while "listening" not in daemon.notes:
            if time.monotonic() > until_s or not daemon.running:
                raise RuntimeError(f"the daemon did not start: {daemon.notes}")
            time.sleep(0.1)
        to = f"udpout:127.0.0.1:{daemon.port}"
        mavsentry("feed", flight.scenario, "--to", to, "--speed", speed, "--truth", flight.truth)
        daemon.stop()
    return [
        Alarm(change["sensor"], change["state"], change["t_us"] * 1e-6)
        for _, change in daemon.changes
        if change["state"] in ALARMS
    ]


def analysed(log: Path, config: Path, out: Path) -> list[Alarm]:
    """Faults and events that ``analyze`` finds in a log."""
    mavsentry("analyze", log, "--config", config, "--out", out)
    summary = json.loads((out / log.stem / "summary.json").read_text())
    found = [Alarm(f["sensor"], "faulty", f["detected_t_us"] * 1e-6) for f in summary["faults"]]
    return found + [
        Alarm(e["what"], e["state"], e["detected_t_us"] * 1e-6) for e in summary["events"]
    ]


def delays(flight: Case, alarms: Sequence[Alarm]) -> tuple[dict[str, float], list[Alarm]]:
    """Delay of the first alarm of every broken sensor [s], inf where none came; other alarms."""
    truth = json.loads((flight.truth / "truth.json").read_text())
    onsets = {f["sensor"]: f["onset_t_us"] * 1e-6 for f in truth["faults"]}
    found = {
        sensor: min(
            (a.t_s - t_s for a in alarms if a.sensor == sensor and a.t_s >= t_s), default=np.inf
        )
        for sensor, t_s in onsets.items()
    }
    return found, [a for a in alarms if a.t_s < onsets.get(a.sensor, np.inf)]


def speed_error(flight: Case) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Published R_N1 minus the shaft's true speed from the first fault on [rpm]."""
    with np.load(flight.truth / "truth.npz") as truth:
        t_us, rpm = truth["t_us"], truth["shaft_rpm"]
    rpm = rpm if rpm.ndim == 1 else rpm[:, 0]
    onset_us = min(
        f["onset_t_us"] for f in json.loads((flight.truth / "truth.json").read_text())["faults"]
    )
    told = np.array(list(published(flight.truth / "published.tlog", "R_N1")))
    told = told[(told[:, 0] >= onset_us) & (told[:, 0] < t_us[-1])]
    return told[:, 1] - np.interp(told[:, 0], t_us, rpm)


def published(log: Path, name: str) -> list[tuple[float, float]]:
    """(vehicle time [us], value) of a NAMED_VALUE_FLOAT in a log of what the daemon sent."""
    from pymavlink import mavutil

    reader = mavutil.mavlink_connection(str(log), dialect="ardupilotmega")
    told = []
    while (message := reader.recv_match(type="NAMED_VALUE_FLOAT")) is not None:
        if message.name == name:
            told.append((message.time_boot_ms * 1e3, message.value))
    reader.close()
    return told


def written(flight: Case) -> Path:
    """The flight as a telemetry log."""
    log = flight.scenario.with_suffix(".tlog")
    if not log.exists():
        mavsentry("feed", flight.scenario, "--to", log, "--truth", flight.truth)
    return log


def configuration(file: Path, engine: Path, airframe: str) -> Path:
    """A configuration file: the learnt engine, and the airframe; its own table is known to 5 %."""
    wing = f'[wing]\nairframe = "{airframe}"\n'
    if airframe == "aerosonde":
        wing += f"coefficient_share = {KNOWN_SHARE}\n"
    file.write_text(f"{engine.read_text()}\n{wing}", encoding="utf-8")
    return file


def wrong_airframe(folder: Path, seed: int) -> Path:
    """The Aerosonde's table with every coefficient 15 % too large or too small."""
    rng = np.random.default_rng([seed, 15])
    numbers = load_airframe("aerosonde")
    for name in AERODYNAMIC:
        numbers[name] *= 1.0 + WRONG_SHARE * float(rng.choice((-1.0, 1.0)))
    file = folder / f"wrong-{seed}.toml"
    lines = (f"{key} = {value!r}" for key, value in numbers.items())
    file.write_text("\n".join(["[numbers]", *lines]) + "\n", encoding="utf-8")
    return file


def told(flights: Sequence[Case], alarms: Sequence[Sequence[Alarm]], title: str) -> None:
    """Print delays by sensor, and every alarm that nothing broken explains."""
    by_sensor: dict[str, list[float]] = {}
    others: list[str] = []
    for flight, found in zip(flights, alarms, strict=True):
        times, false = delays(flight, found)
        for sensor, delay in times.items():
            by_sensor.setdefault(sensor, []).append(delay)
        others += [
            f"{flight.name}-{flight.seed}: {a.sensor} {a.state} {a.t_s:.1f} s" for a in false
        ]
    shown = "; ".join(
        f"{sensor} {', '.join(f'{d:.1f}' for d in values)} s (median {median(values):.1f})"
        for sensor, values in by_sensor.items()
    )
    print(
        f"{title}: {len(flights)} flights; {shown or 'nothing broken'}; false {others or 'none'}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("aerosonde-live"))
    parser.add_argument("--seeds", type=int, default=10, help="healthy flights")
    parser.add_argument("--broken-seeds", type=int, default=3, help="flights of each fault")
    parser.add_argument("--first-seed", type=int, default=8001)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--part", choices=("live", "models", "all"), default="all")
    chosen = parser.parse_args()
    out: Path = chosen.out
    out.mkdir(parents=True, exist_ok=True)
    teachers = [written(case(out, HEALTHY, seed)) for seed in LEARN_FROM]
    engine = out / "engine.toml"
    print(mavsentry("learn", "engine", *teachers, "--out", engine, "--force"), flush=True)
    first = chosen.first_seed
    groups = {HEALTHY: [case(out, HEALTHY, first + k) for k in range(chosen.seeds)]} | {
        name: [case(out, name, first + 100 + k) for k in range(chosen.broken_seeds)]
        for name in (*BROKEN, RPM, "aerosonde-engine-cut")
    }
    with ThreadPoolExecutor(chosen.jobs) as pool:
        if chosen.part != "models":
            live(groups, engine, out, chosen.speed, pool)
        if chosen.part != "live":
            for k in range(N_MODELS):
                with_model(k, groups, engine, teachers, out, pool)


def live(
    groups: Mapping[str, Sequence[Case]],
    engine: Path,
    out: Path,
    speed: float,
    pool: ThreadPoolExecutor,
) -> None:
    """Print what daemons find over UDP with the right coefficients."""
    config = configuration(out / "right.toml", engine, "aerosonde")
    flying = {
        name: [pool.submit(flown_live, flight, config, speed) for flight in flights]
        for name, flights in groups.items()
    }
    for name, flights in groups.items():
        told(flights, [landed.result() for landed in flying[name]], f"live, {name}")
    for flight in groups[RPM]:
        error = np.abs(speed_error(flight)) / engine_range(engine)
        print(f"  {flight.name}-{flight.seed}: 95 % error {np.quantile(error, 0.95):.2%} of range")


def with_model(
    k: int,
    groups: Mapping[str, Sequence[Case]],
    engine: Path,
    teachers: Sequence[Path],
    out: Path,
    pool: ThreadPoolExecutor,
) -> None:
    """Print what ``analyze`` finds with a wrong model, and with what was learnt from it."""
    start, learnt_file = wrong_airframe(out, k), out / f"learnt-{k}.toml"
    off = configuration(out / f"config-{k}.toml", engine, str(start))
    options = ("--start", start, "--config", off, "--out", learnt_file, "--force")
    mavsentry("learn", "airframe", *teachers, *options)
    learnt = configuration(out / f"config-learnt-{k}.toml", engine, str(learnt_file))
    for config, word in ((off, "15 % off"), (learnt, "the same, learnt")):
        for name in (HEALTHY, *BROKEN):
            results = pool.map(
                lambda flight, config=config: analysed(written(flight), config, out / config.stem),
                groups[name],
            )
            told(groups[name], list(results), f"model {k} {word}, {name}")


def engine_range(engine: Path) -> float:
    """Range of the first channel of a learnt engine [rpm]."""
    channels = tomllib.loads(engine.read_text())["engine"]["channels"]
    return float(channels["spool0"]["range_rpm"])


if __name__ == "__main__":
    main()
