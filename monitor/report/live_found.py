"""What a monitor said in flight, as sentences and rows, out of ``live`` of a ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from monitor.pages.html import clock
from monitor.report.wording import count, lasting, moments

__all__ = ["live_lines"]


def live_lines(live: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """What a monitor said in flight: a sentence per monitor, and the rows of the comparison.

    Columns: sensor, live (said, cleared), replay (named, cleared), how far live was behind, the
    words in flight.
    """
    sentences = []
    for monitor in live["monitors"]:
        own = [f for f in live["faults"] if f["component_id"] == monitor["component_id"]]
        silences = [(s["from_s"], s["to_s"]) for s in monitor["silent"]]
        silent = f", silent {moments(silences)}" if silences else ""
        said = "" if own else "; it said of no fault"
        sentences.append(
            f"Component {monitor['component_id']} was heard from {clock(monitor['from_s'])} to "
            f"{clock(monitor['to_s'])} ({count(monitor['words'], 'word')}){silent}{said}."
        )
    rows = [
        [
            f["sensor"],
            _from_to(f["live_s"], f["live_cleared_s"], f["standing"]),
            _from_to(f["replay_s"], f["replay_cleared_s"]),
            _behind(f),
            f["said"] or "–",
        ]
        for f in live["faults"]
    ]
    return sentences, rows


def _from_to(from_s: float | None, to_s: float | None, standing: bool = False) -> str:
    if from_s is None:
        return "not said"
    until = "to the end" if to_s is None else f"to {clock(to_s, 1)}"
    return f"{'before ' if standing else ''}{clock(from_s, 1)} {until}"


def _behind(fault: Mapping[str, Any]) -> str:
    delay_s = fault["delay_s"]
    if delay_s is None:
        words = {"not heard": "nothing was heard then", "both": "stood already"}
        return words.get(fault["agreement"], str(fault["agreement"]))
    return f"{lasting(abs(delay_s))} {'earlier' if delay_s < 0 else 'later'}"
