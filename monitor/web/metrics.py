"""Prometheus metrics of what the web process knows: made when asked for, of the newest frame."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector, CollectorRegistry

from links.vocabulary import State
from monitor.web.store import Store
from monitor.web.viewers import Viewers

__all__ = ["exposition"]

PREFIX: Final = "mavsentry"

_LINK: Final = (
    ("datagrams", "datagrams", "Datagrams (or chunks of a stream) received."),
    ("received_bytes", "bytes", "Bytes received."),
    ("bad_bytes", "bad_bytes", "Bytes received that belong to no frame."),
    ("lost_messages", "lost", "Messages missing from the sequence numbers."),
    ("sent_messages", "sent", "Messages published."),
)
"""Counter, key of ``link``, help."""

_MS, _MB = 1e-3, 1e6


def exposition(store: Store, viewers: Viewers) -> tuple[bytes, str]:
    """Metrics in Prometheus' text format, and its content type."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(store, viewers))
    encode, kind = choose_encoder("")
    return encode(registry), kind


class _Collector(Collector):
    """Turns the store into metric families."""

    def __init__(self, store: Store, viewers: Viewers) -> None:
        self._store, self._viewers = store, viewers

    def collect(self) -> Iterator[Metric]:
        """Every family of which something is known."""
        yield from _web(self._viewers)
        now = self._store.now
        if not now:
            return
        yield from _about(now)
        yield from _sensors(self._store)
        if now.get("link"):
            yield from _link(now["link"])
        for key, families in _BY_KEY.items():
            if now.get(key):
                yield from families(now[key])


def _about(now: Mapping[str, Any]) -> Iterator[Metric]:
    about = InfoMetricFamily(f"{PREFIX}_build", "Version and profile of the daemon.")
    about.add_metric([], {"version": now["version"], "profile": now["profile"]})
    yield about
    yield _gauge("start_time_seconds", "Unix time of the daemon's start.", now["started_unix_s"])
    yield _gauge("snapshot_number", "Number of the newest frame.", now["number"])
    yield _gauge("flying", "1 in flight, when sensors are judged.", now["flying"])
    if now["t_s"] is not None:
        said = "Vehicle time up to which everything is judged."
        yield _gauge("vehicle_time_seconds", said, now["t_s"])


def _sensors(store: Store) -> Iterator[Metric]:
    states = GaugeMetricFamily(
        f"{PREFIX}_sensor_state", "1 for the state that a sensor is in.", labels=["sensor", "state"]
    )
    for sensor, standing in sorted(store.states()):
        for state in State:
            states.add_metric([sensor, str(state)], float(standing == state))
    yield states
    faults = CounterMetricFamily(f"{PREFIX}_faults", "Faults found.", labels=["sensor"])
    for sensor, _ in sorted(store.states()):
        faults.add_metric([sensor], store.found[sensor])
    yield faults


def _link(link: Mapping[str, Any]) -> Iterator[Metric]:
    said = "1 while nothing is heard of the vehicle for the configured time."
    yield _gauge("link_silent", said, link["silent"])
    yield _gauge("link_datagrams_per_second", "Datagrams received.", link["datagrams_s"])
    yield _gauge("link_samples_per_second", "Samples decoded.", link["rows_s"])
    for name, key, told in _LINK:
        yield CounterMetricFamily(f"{PREFIX}_link_{name}", told, link[key])


def _streams(streams: Mapping[str, Mapping[str, Any]]) -> Iterator[Metric]:
    families = (
        (GaugeMetricFamily, "rate_hertz", "rate_hz", "Samples per second."),
        (CounterMetricFamily, "samples", "samples", "Samples used."),
        (CounterMetricFamily, "gaps", "gaps", "Intervals longer than the stream's time-out."),
        (GaugeMetricFamily, "stale", "stale", "1 while the stream has stopped."),
    )
    for kind, name, key, told in families:
        family = kind(f"{PREFIX}_stream_{name}", told, labels=["stream"])
        for stream, account in streams.items():
            family.add_metric([stream], float(account[key]))
        yield family


def _rejected(rejected: Mapping[str, Mapping[str, int]]) -> Iterator[Metric]:
    told = "Bytes, messages and samples that were not used."
    family = CounterMetricFamily(f"{PREFIX}_rejected", told, labels=["what", "reason"])
    for what, reasons in rejected.items():
        for reason, count in reasons.items():
            family.add_metric([what, reason], count)
    yield family


def _latency(latency: Mapping[str, Any]) -> Iterator[Metric]:
    told = "From the arrival of a datagram to our answer, over the newest answers."
    family = GaugeMetricFamily(f"{PREFIX}_answer_latency_seconds", told, labels=["quantile"])
    for quantile, key in (("0.5", "median_ms"), ("0.99", "p99_ms"), ("1", "worst_ms")):
        if latency[key] is not None:
            family.add_metric([quantile], latency[key] * _MS)
    yield family
    yield CounterMetricFamily(
        f"{PREFIX}_answers", "Times that messages beside a heartbeat were sent.", latency["count"]
    )


def _recorder(recorder: Mapping[str, Any]) -> Iterator[Metric]:
    told = "1 while the link is recorded."
    yield _gauge("recorder_recording", told, recorder["stopped"] is None)
    yield CounterMetricFamily(f"{PREFIX}_recorder_bytes", "Bytes recorded.", recorder["bytes"])


def _process(process: Mapping[str, Any]) -> Iterator[Metric]:
    cpu = CounterMetricFamily(
        f"{PREFIX}_process_cpu_seconds", "Processor time used.", labels=["process"]
    )
    memory = GaugeMetricFamily(
        f"{PREFIX}_process_resident_memory_bytes", "Memory held.", labels=["process"]
    )
    cpu.add_metric(["daemon"], process["cpu_s"])
    cpu.add_metric(["web"], time.process_time())
    if process["memory_mb"] is not None:
        memory.add_metric(["daemon"], process["memory_mb"] * _MB)
    if (held := _resident_bytes()) is not None:
        memory.add_metric(["web"], held)
    yield cpu
    yield memory
    told = "Frames that the web process did not take in time."
    yield CounterMetricFamily(f"{PREFIX}_snapshots_dropped", told, process["dropped"])
    if process["snapshot_ms"] is not None:
        told = "Processor time of the daemon for one frame."
        yield _gauge("snapshot_cpu_seconds", told, process["snapshot_ms"] * _MS)


def _web(viewers: Viewers) -> Iterator[Metric]:
    yield _gauge("web_viewers", "Pages that are open.", len(viewers))
    told = "Pages that there was no room for."
    yield CounterMetricFamily(f"{PREFIX}_web_viewers_refused", told, viewers.refused)
    told = "Frames dropped for slow pages."
    yield CounterMetricFamily(f"{PREFIX}_web_frames_dropped", told, viewers.dropped)


_BY_KEY: Final[Mapping[str, Callable[[Any], Iterator[Metric]]]] = {
    "streams": _streams,
    "rejected": _rejected,
    "latency": _latency,
    "recorder": _recorder,
    "process": _process,
}


def _gauge(name: str, told: str, value: float) -> Metric:
    return GaugeMetricFamily(f"{PREFIX}_{name}", told, float(value))


def _resident_bytes() -> int | None:
    """Memory that this process holds; None where it is not told."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")
