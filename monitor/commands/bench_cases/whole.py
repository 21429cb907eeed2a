"""The program as a whole: the pipeline against real time, start, live latency."""

from __future__ import annotations

import socket
import statistics
import threading
import time
from collections.abc import Callable
from pathlib import Path

from links.logs import read_tlog
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.commands.bench_cases import BenchCase, Measured
from monitor.commands.daemon_process import DaemonProcess, free_port
from monitor.learn.engine import learn_engine, measure_engine
from monitor.learn.engine_document import engine_document
from monitor.pipeline import Pipeline
from monitor.recorder import whole_frames
from monitor.settings import load
from monitor.warmup import warm_up

__all__ = ["cases", "known_aircraft"]

REPEATS = 3
IN_FLIGHT_S = 60.0
"""Seconds into the log at which the aircraft is taken to be flying."""

START_TIMEOUT_S = 60.0


def cases(
    log: Path,
    long_flight: Callable[[], Path],
    sixdof_flight: Callable[[], Path] | None,
    minutes: float,
) -> list[BenchCase]:
    """Cases on a telemetry log, and on longer ones with IMU samples at 200 Hz, made if needed.

    Parameters
    ----------
    log
        A healthy flight.
    long_flight
        Makes one of the kinematic vehicle.
    sixdof_flight
        Makes one of the Aerosonde with three engine-speed sensors; None without JSBSim.
    minutes
        How long a live link is watched.
    """
    return [
        BenchCase(
            "pipeline",
            unit="times real time",
            value=lambda: _pipeline(log),
            note="decoded samples of a whole flight to verdicts",
        ),
        BenchCase(
            "start_to_verdict_s",
            unit="s",
            value=lambda: _start_to_verdict(log),
            note="start of `mavsentry run` with the feed in flight to the first ok of imu0",
        ),
        BenchCase(
            "latency_ms",
            unit="ms",
            value=lambda: _latency(long_flight(), minutes),
            note="arrival of the oldest datagram of a turn to our last datagram of that turn",
        ),
        BenchCase(
            "latency_all_ms",
            unit="ms",
            value=None
            if sixdof_flight is None
            else lambda: _latency_of_all(sixdof_flight(), minutes),
            note="the same with engine and wings watched too: the Aerosonde, IMUs at 200 Hz",
            missing=() if sixdof_flight is not None else ("jsbsim",),
        ),
    ]


def _pipeline(log: Path) -> Measured:
    settings = load()
    warm_up(settings)
    batches = list(read_tlog(log, settings.links.decoder_options()))
    rows = [r["t_us"] for batch in batches for r in batch.rows.values() if len(r)]
    flight_s = (max(int(t[-1]) for t in rows) - min(int(t[0]) for t in rows)) / 1e6

    def once() -> None:
        pipeline = Pipeline(settings)
        for batch in batches:
            pipeline.feed(batch)
        pipeline.finish()

    return _against(flight_s, [_timed(once) for _ in range(REPEATS)])


def _against(flight_s: float, taken_s: list[float]) -> Measured:
    median_s = statistics.median(taken_s)
    return Measured(
        flight_s / median_s, median_s * 1e6, max(taken_s) * 1e6, f"{flight_s:.0f} s of flight"
    )


def _timed(work: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    work()
    return time.perf_counter() - began_s


def _start_to_verdict(log: Path) -> Measured:
    warm_up(load())
    taken_s = []
    for _ in range(REPEATS):
        with _Sender(log, IN_FLIGHT_S) as sender:
            time.sleep(0.5)
            with DaemonProcess(port=sender.port) as daemon:
                taken = daemon.wait_for({"sensor": "imu0", "state": "ok"}, START_TIMEOUT_S)
        if taken is None:
            return Measured(float("nan"), note="no ok of imu0 came")
        taken_s.append(taken)
    return Measured(statistics.median(taken_s), note=f"worst of {REPEATS}: {max(taken_s):.2f} s")


def _latency_of_all(log: Path, minutes: float) -> Measured:
    """Latency with airframe and engine known."""
    return _latency(log, minutes, ("--config", str(known_aircraft(log))))


def known_aircraft(log: Path) -> Path:
    """Configuration with the Aerosonde's airframe, and the engine learnt from this very flight."""
    engine = learn_engine([measure_engine(log, load())], load())
    config = log.with_suffix(".toml")
    carried = {"wing": {"airframe": "aerosonde"}}
    config.write_text(engine_document(engine, carried), encoding="utf-8")
    return config


def _latency(log: Path, minutes: float, arguments: tuple[str, ...] = ()) -> Measured:
    with _Sender(log, 0.0) as sender, DaemonProcess(arguments, sender.port) as daemon:
        daemon.wait_for({"sensor": "imu0", "state": "ok"}, START_TIMEOUT_S)
        cpu_s, memory_mb = daemon.usage()
        began_s = time.monotonic()
        while time.monotonic() - began_s < 60.0 * minutes and daemon.running:
            time.sleep(0.2)
        later_cpu_s, later_memory_mb = daemon.usage()
        wall_s = time.monotonic() - began_s
        daemon.stop()
        status = daemon.last_status or {}
    latency = status.get("latency", {})
    share = (later_cpu_s - cpu_s) / wall_s
    return Measured(
        latency.get("median_ms", float("nan")),
        1e3 * latency.get("median_ms", float("nan")),
        1e3 * latency.get("p99_ms", float("nan")),
        f"{latency.get('count', 0)} answers in {wall_s:.0f} s, worst "
        f"{latency.get('worst_ms', float('nan')):.1f} ms; {100 * share:.1f} % of one core; "
        f"resident {memory_mb:.0f} MB at the beginning, {later_memory_mb:.0f} MB at the end",
    )


class _Sender:
    """Sends a log's frames to a UDP port of the loopback at their own pace, in a thread."""

    def __init__(self, log: Path, from_s: float) -> None:
        framer = Framer(load_dialect(), stamped=True)
        parts = (framer.feed(log.read_bytes()), framer.finish())
        frames = [(stamp, frame) for part in parts for frame, stamp in whole_frames(part)]
        first_us = frames[0][0] + round(from_s * 1e6)
        self._frames = [((us - first_us) / 1e6, data) for us, data in frames if us >= first_us]
        self.port = free_port()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)

    def __enter__(self) -> _Sender:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _send(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            began_s = time.monotonic()
            for due_s, frame in self._frames:
                ahead_s = began_s + due_s - time.monotonic()
                if ahead_s > 0.0005 and self._ended.wait(ahead_s):
                    return
                # Nobody may listen yet: the loopback then refuses a datagram, which is no error.
                try:
                    out.sendto(frame, ("127.0.0.1", self.port))
                except ConnectionRefusedError:
                    continue
