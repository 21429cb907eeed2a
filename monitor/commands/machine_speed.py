"""How fast this computer is: a flight fed as it comes in live, and the processor time it takes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from monitor.settings import Settings

__all__ = ["EXTRAS", "LiveCost", "live_cost", "missing_extras"]

TURN_S = 0.02
"""What comes in for this long is worked on together, as in the daemon [s]."""

FROM, LENGTH_S = 0.5, 20.0
"""The part of the flight that is timed: from its middle on, when all has been learnt."""

EXTRAS = {
    "serial": (("serial",), "serial ports"),
    "report": (("bokeh", "jinja2", "pyarrow"), "report.html and Parquet files"),
    "web": (("bokeh", "jinja2", "prometheus_client", "tornado"), "the live page"),
    "fleet": (("dask", "distributed", "fsspec", "pyarrow", "jinja2"), "archives of logs"),
    "sim": (("jsbsim",), "JSBSim aircraft"),
}
"""Extra -> the modules that it brings, and what they are for."""


@dataclass(frozen=True, slots=True)
class LiveCost:
    """Processor time per second of flight.

    Attributes
    ----------
    share
        Decoding and judging together [s/s].
    parts
        What of it each part takes [s/s]: ``decode``, each watch, and ``other`` (order, flight
        phase, streams).
    seconds
        Flight time that was measured over [s].
    messages_hz
        Messages in a second of that flight [1/s].
    """

    share: float
    parts: dict[str, float]
    seconds: float
    messages_hz: float


def live_cost(log: Path, duration_s: float, settings: Settings) -> LiveCost:
    """Feed a recorded flight in the small pieces of a live link and time the middle of it.

    Parameters
    ----------
    log
        Telemetry log.
    duration_s
        Its length [s].
    settings
        Which watches there are.
    """
    from links.mavlink import Decoder
    from links.mavlink.dialect import load_dialect
    from links.mavlink.framing import Framer
    from monitor.pipeline import Pipeline
    from monitor.recorder import whole_frames
    from monitor.watch import build_watches

    framer = Framer(load_dialect(settings.links.dialect), stamped=True)
    parts_of_log = (framer.feed(log.read_bytes()), framer.finish())
    frames = [frame for part in parts_of_log for frame, _ in whole_frames(part)]
    per_turn = max(1, round(len(frames) / duration_s * TURN_S))
    begin = round(FROM * len(frames))
    end = min(len(frames), begin + round(LENGTH_S / duration_s * len(frames)))
    turns = [b"".join(frames[i : i + per_turn]) for i in range(begin, end, per_turn)]

    names = [watch.name for watch in build_watches(settings)]
    judged: dict[str, float] = {}
    decoded = []
    for only in (None, "", *names):  # all watches, none, each alone
        watches = [w for w in build_watches(settings) if only is None or w.name == only]
        decoder, pipeline = Decoder(settings.links.decoder_options()), Pipeline(settings, watches)
        pipeline.feed(decoder.feed(b"".join(frames[:begin])))
        decode_s = judge_s = 0.0
        for turn in turns:
            began_s = time.process_time()
            batch = decoder.feed(turn)
            between_s = time.process_time()
            pipeline.feed(batch)
            decode_s += between_s - began_s
            judge_s += time.process_time() - between_s
        decoded.append(decode_s)
        judged["all" if only is None else only] = judge_s
    seconds = (end - begin) / len(frames) * duration_s
    parts = {"decode": min(decoded), "other": judged[""]}
    parts |= {name: max(0.0, judged[name] - judged[""]) for name in names}
    return LiveCost(
        share=(min(decoded) + judged["all"]) / seconds,
        parts={name: s / seconds for name, s in parts.items()},
        seconds=seconds,
        messages_hz=(end - begin) / seconds,
    )


def missing_extras() -> list[str]:
    """Extras of which a module is not installed."""
    return [
        extra
        for extra, (modules, _) in EXTRAS.items()
        if any(find_spec(module) is None for module in modules)
    ]
