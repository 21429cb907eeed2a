"""Learnt thresholds as a file that ``--config`` takes, each key with what it rests on."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from monitor.learn.calibrate import Calibration
from monitor.learn.rules import Kind
from monitor.learn.thresholds import FACTOR, Change, Learnt, Outcome
from monitor.toml import toml_value

__all__ = ["change_sentence", "crossed_sentence", "document"]

WIDTH = 96

_HEAD = """\
# Thresholds{airframe}, learnt from {flights} healthy flights by `mavsentry learn thresholds`.
# Use: mavsentry run --config FILE, mavsentry analyze LOG --config FILE. Keys that are commented out
# stay at their default. `mavsentry config show --config FILE` tells what is in force.
profile = "{profile}"
"""


def document(calibration: Calibration, by_hand: Mapping[str, Any]) -> str:
    """The file as TOML.

    Parameters
    ----------
    calibration
        What was learnt, and from what.
    by_hand
        Tables of the file that it was learnt over, if there was one: they are carried along.
    """
    learnt = calibration.learnt
    provenance = learnt.settings.learnt
    airframe = f" of {provenance.airframe}" if provenance.airframe else ""
    head = _HEAD.format(
        airframe=airframe, flights=len(provenance.logs), profile=learnt.settings.profile
    )
    for out in calibration.left_out:
        head += _comment(f"Left out, not healthy: {out.name}: {out.why}")
    if sentence := crossed_sentence(calibration):
        head += _comment(sentence)
    sections = dict(_tables(by_hand))
    for change in learnt.changes:
        sections.setdefault(change.key.rpartition(".")[0], {})
    body = [_section(table, own, learnt) for table, own in sorted(sections.items())]
    return "\n".join([head, *body, _provenance(learnt)])


def _tables(values: Mapping[str, Any], name: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every table within the values by its dotted name, with its plain keys."""
    plain = {k: v for k, v in values.items() if not isinstance(v, Mapping)}
    if plain:
        yield name, plain
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _tables(value, f"{name}.{key}" if name else key)


def crossed_sentence(calibration: Calibration) -> str:
    """What became of each flight judged by what the others teach; empty where nobody looked."""
    if calibration.crossed is None:
        return ""
    flights, crossed = len(calibration.numbers), calibration.crossed
    said = f"Judged by what the others teach, {flights - len(crossed)} of {flights} flights are "
    said += "silent"
    if not crossed:
        return said + "."
    names = "; ".join(
        f"{name}: {a.sensor} {a.state} at {a.detected_s:.1f} s" for name, a in crossed
    )
    return (
        f"{said}; not {names}. If something was wrong there, leave it out; if not, flights to come "
        "may show more than these."
    )


def _comment(text: str) -> str:
    clean = " ".join(text.split())
    lines = textwrap.wrap(clean, WIDTH, initial_indent="# ", subsequent_indent="# ")
    return "\n".join(lines) + "\n"


def change_sentence(change: Change) -> str:
    """What a key rests on, in one or two sentences."""
    c = change
    said = f"{c.outcome.value[0].upper()}{c.outcome.value[1:]}"
    if not math.isnan(c.peak):
        of = f" ({c.log})" if c.log else ""
        moved = c.outcome in (Outcome.RAISED, Outcome.LOWERED) and c.kind is not Kind.LEVEL
        times = f" times {math.pow(FACTOR, 1.0 / c.power):.3g}" if moved else ""
        said += f": healthy maximum {c.peak:.3g}{of}{times}"
        said += f", {c.flights} flights, {c.seconds / 3600.0:.2f} h judged"
    if c.value != c.default and c.without != c.value:
        said += f"; {c.without:g} without that flight"
    default = "the default" if c.floor == c.default else f"{c.floor:g}"
    return f"{said}. Default {c.default:g}. Floor {default}: {c.why}."


def _section(table: str, by_hand: Mapping[str, Any], learnt: Learnt) -> str:
    """One table: keys set by hand, keys learnt, and in comments those kept."""
    own = {c.key.rpartition(".")[2]: c for c in learnt.changes if c.key.rpartition(".")[0] == table}
    lines = [f"[{table}]"]
    lines += [f"{key} = {toml_value(value)}" for key, value in by_hand.items() if key not in own]
    for name, change in own.items():
        lines.append(_comment(change_sentence(change)).rstrip())
        in_force = change.value != change.default or name in by_hand
        lines.append(f"{'' if in_force else '# '}{name} = {change.value!r}")
    return "\n".join(lines) + "\n"


def _provenance(learnt: Learnt) -> str:
    """The ``[learnt]`` table."""
    p = learnt.settings.learnt
    return "\n".join(_provenance_lines(p.model_dump()))


def _provenance_lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield "# Where this comes from: `analyze` says so when it meets one of these very flights."
    yield "[learnt]"
    for key, value in values.items():
        if key != "logs":
            yield f"{key} = {toml_value(value)}"
    for log in values["logs"]:
        yield ""
        yield "[[learnt.logs]]"
        for key, value in log.items():
            yield f"{key} = {toml_value(value)}"
    yield ""
