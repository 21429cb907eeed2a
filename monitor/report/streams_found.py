"""What arrived, what was missing and what was refused, out of a ``summary.json``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from monitor.pages.html import clock
from monitor.report.remedies import REJECTED
from monitor.report.wording import count, lasting, number

__all__ = ["damage", "recorded", "rejections", "stream_rows"]

Summary = Mapping[str, Any]

NAMED: Final = 4

_WHAT: Final = {
    "frame": "whole messages",
    "nav": "nav (the autopilot's own position)",
    "servo": "servo (outputs)",
    "text": "text (STATUSTEXT)",
    "param": "param (parameters)",
    "named": "named (NAMED_VALUE_FLOAT)",
}


def stream_rows(summary: Summary) -> list[list[str]]:
    """Sensor, source message, samples, rate and gaps of every stream."""
    return [
        [
            _WHAT.get(s["sensor"], s["sensor"]),
            s["source"] or "–",
            f"{s['samples']:,}",
            _rate(s["rate_hz"]),
            f"{s['gaps']:,}" if s["gaps"] else "none",
        ]
        for s in summary["streams"]
    ]


def _sentence(note: str) -> str:
    """A note with a full stop, and a capital where it does not begin with a message's name."""
    named = "_" in note.partition(" ")[0]
    return f"{note if named else note[:1].upper() + note[1:]}".rstrip(".") + "."


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.1f}" if rate_hz >= 0.95 else number(rate_hz, 2)


def rejections(summary: Summary) -> list[list[str]]:
    """Sensor, reason, how often, and what the reason means; the most frequent first."""
    rows = [
        (times, where, reason)
        for where, reasons in summary["rejected"].items()
        for reason, times in reasons.items()
    ]
    return [
        [_WHAT.get(where, where), reason, f"{times:,}", REJECTED.get(reason, "")]
        for times, where, reason in sorted(rows, key=lambda row: (-row[0], row[1:]))
    ]


def recorded(summary: Summary) -> list[tuple[float, float]]:
    """Spans of the log in which something was recorded: all of it but the gaps [s]."""
    out, at_s = [], 0.0
    for gap in sorted(summary["log"]["gaps"], key=lambda g: g["at_s"]):
        if gap["at_s"] > at_s:
            out.append((at_s, float(gap["at_s"])))
        at_s = max(at_s, gap["at_s"] + gap["seconds"])
    if summary["log"]["duration_s"] > at_s:
        out.append((at_s, float(summary["log"]["duration_s"])))
    return out


def damage(summary: Summary) -> list[str]:
    """What is wrong with the log itself, in sentences; empty if it is whole."""
    log = summary["log"]
    lines = []
    if log["bad_bytes"]:
        share = 100.0 * log["bad_bytes"] / max(log["bytes"], 1)
        lines.append(
            f"Damaged: {count(log['bad_bytes'], 'byte')} ({number(share, 2)} %) belong to no "
            "message."
        )
    if gaps := log["gaps"]:
        longest = sorted(gaps, key=lambda g: -g["seconds"])[:NAMED]
        named = ", ".join(
            f"{lasting(g['seconds'])} from {clock(max(g['at_s'], 0.0))}"
            for g in sorted(longest, key=lambda g: g["at_s"])
        )
        rest = len(gaps) - len(longest)
        more = f" and {count(rest, 'shorter one')}" if rest else ""
        lines.append(f"{count(len(gaps), 'gap')} in the recording: {named}{more}.")
    if boots := log["boots_s"]:
        named = ", ".join(clock(t_s) for t_s in boots[:NAMED])
        more = f" and {len(boots) - NAMED} more times" if len(boots) > NAMED else ""
        lines.append(f"The vehicle started anew at {named}{more}.")
    lines += [_sentence(note) for note in log["notes"]]
    left = {what: many for what, many in summary["left_out"].items() if many}
    lines += [f"{many:,} more {what} are not listed." for what, many in left.items()]
    return lines
