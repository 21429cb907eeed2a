"""``docs/detectability.md``: the table, how it was made, and what its words mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isinf
from typing import Any

from monitor.commands.bench_detect.bounds import share_lower
from monitor.commands.bench_detect.search import misses_allowed
from monitor.commands.bench_detect.table import Row, alarm_rows, rows
from monitor.commands.bench_detect.trials import AFTERMATH_S

__all__ = ["PICTURE", "page"]

Json = dict[str, Any]

PICTURE = "detectability.svg"
"""File name beside the page."""

_HOW = """\
## How it was made

{quick}**Flights.** Synthetic flights are those of the synthetic vehicle (`sim_feeds`):
take-off, climb, a random route of turns, straight legs, climbs and changes of speed, landing,
with random heading, mean wind (small-uav up to 12 m/s, light-aircraft 15, transport 25) and
MIL-F-8785C turbulence that grows with it. They are sent as MAVLink and decoded again; no
threshold was set on them. Recorded flights are telemetry logs without a sensor fault, grouped
by their folder.

**Configurations.** Instruments are taken out of the flight as their names say. *The attitude
follows it*: the autopilot's attitude is computed from the broken IMU, through a first-order
complementary filter (`sim_feeds/attitude_follow.py`). *Attitude of its own*: the attitude stays
as it was, as from a reference with gyros of its own, and the monitor is told so. Always the
first instrument is broken, one channel at a time.

**Trials.** The fault is laid over the decoded samples (open loop: the aircraft flies as it
flew) at a random moment at which the sensors in question are `ok` and {longest} s of flight are
left, reading high or low at random. A step is a bias, of a pitot a scale; a ramp grows from
zero and is given per minute. *Found* is the verdict `faulty` on the broken sensor and axis
itself, in vehicle time after the onset. Where the attitude follows the only IMU, `acc_x` and
`gyro_y`, and `acc_y` and `gyro_x`, cannot always be told apart: there the pair counts as found,
and *by its pair* says in how many trials it was named instead.

**Sizes** are tried on a ladder by bisection (steps: 1, 1.5, 2, 3, 5, 7 of each decade; ramps:
1, 2, 5), with the same {trials} moments on every rung; a size passes when at least {enough} of
them are found. `> 10` means that not even 10 passed, `<= 0.1` that the smallest tried did.
{trials} of {trials} found proves a true share of {all_share} %, {enough} of {trials} one of
{enough_share} % (Clopper-Pearson, one-sided 95 %): read a size as good to about one rung. The
JSON output has the delays of all trials.

**Blame errors** are counted over all trials of all sizes tried, small and gross ones alike,
until {aftermath} s after the right sensor was named: trials in which another axis of the same
IMU, or another instrument, was called faulty as well, and trials in which a wrong one came
first or alone. A suspicion or an announced disagreement is no blame.

*Announced / named*: medians, over the steps that were found, until two IMUs were said to disagree
and until the broken one was named. The columns of sizes count the naming.

**Not in it**: other shapes of faults (noise, stuck, oscillation, blocked tubes), an autopilot
that steers on the broken sensor, and pitots that fail together.
"""


def page(document: Json) -> str:
    """The whole page."""
    return "\n".join([*_head(document), *_alarms(document), *_groups(document), _how(document)])


def _head(document: Json) -> Iterator[str]:
    trials = document["trials"]
    enough = trials - misses_allowed(trials)
    windows = _listed([f"{w:g}" for w in document["windows_s"]])
    yield "# How small a fault is found, and how soon"
    yield ""
    yield (
        "The smallest step and the smallest ramp of each sensor that is named as faulty within "
        f"{windows} seconds, in {enough} of {trials} trials; what is blamed wrongly on the way; "
        "and the bound on false alarms with the healthy hours that it rests on. Made by"
    )
    yield ""
    yield "<!-- elsewhere: takes long -->"
    yield "```console"
    yield f"$ {document['command']}"
    yield "```"
    yield ""
    load = document["machine"]["load_1min"] or 0.0
    busy = f", beside other work (load {load:.0f})" if load > document["jobs"] + 1 else ""
    yield (
        f"mavsentry {document['version']}, seed {document['seed']}, "
        f"{document['took_s'] / 60.0:.0f} minutes on {document['jobs']} processes of "
        f"{document['machine']['processor']}{busy}. What the words mean stands "
        "[below](#how-it-was-made)."
    )
    yield ""
    yield (
        f"![Time within which {enough} of {trials} trials were named, against the size of a step]"
        f"({PICTURE})"
    )
    yield ""


def _alarms(document: Json) -> Iterator[str]:
    yield "## False alarms"
    yield ""
    yield (
        "Every flight is also judged unbroken, in each configuration. The bound is the largest "
        "true rate that leaves 5 % for so few false alarms (Poisson; 3 / hours for none): it "
        "proves no more than the hours allow. The configurations of one group judge the same "
        "flights, so their hours must not be added."
    )
    yield ""
    head = ("flights", "configuration", "number", "judged hours", "false alarms", "at most an hour")
    yield from _table(
        head,
        "ll" + "r" * 4,
        (
            (
                row.group,
                row.configuration,
                str(row.flights),
                f"{row.judged_h:.2f}",
                str(row.false),
                "no bound" if isinf(row.upper_per_h) else f"{row.upper_per_h:.2g}",
            )
            for row in alarm_rows(document)
        ),
    )
    for group in document["groups"]:
        for part in group["configurations"]:
            for flight in part["flights"]:
                for false in flight["false"]:
                    yield (
                        f"- {group['name']}, {part['configuration']}, {flight['name']}: "
                        f"{false['sensor']} at {false['detected_s']:.1f} s, {false['evidence']}"
                    )
                    yield ""


def _groups(document: Json) -> Iterator[str]:
    for group in document["groups"]:
        yield f"## {group['name']} ({'recorded' if group['recorded'] else 'synthetic'})"
        yield ""
        yield from _flights(group)
        found = list(rows(group))
        for part in group["configurations"]:
            name = part["configuration"]
            yield f"### {group['name']}: {name}"
            yield ""
            if part["cells"]:
                own = [row for row in found if row.configuration == name]
                yield from _sizes(own, [f"{w:g} s" for w in document["windows_s"]])
            else:
                yield "No flight leaves a longest window after its sensors are judged."
                yield ""


def _sizes(own: Sequence[Row], windows: Sequence[str]) -> Iterator[str]:
    """Table of one configuration, with the columns that mean something in it."""
    imu = any(row.sensor.startswith(("acc", "gyro")) for row in own)
    paired = any(row.by_pair is not None for row in own)
    earlier = any(row.announced_s < row.named_s for row in own)
    none = [""] * len(windows)
    head = [
        "broken",
        *(f"step {w}" for w in windows),
        *(f"ramp/min {w}" for w in windows),
        "trials",
        *(["by its pair"] if paired else []),
        *(["announced / named"] if earlier else []),
        *(["wrong axis"] if imu else []),
        "wrong instrument",
        "wrong first",
    ]
    body = [
        [
            f"`{row.sensor}` [{row.unit}]",
            *(row.step or none),
            *(row.ramp or none),
            str(row.trials),
            *([str(row.by_pair)] if paired else []),
            *([f"{row.announced_s:.1f} / {row.named_s:.1f} s"] if earlier else []),
            *([str(row.wrong_axis)] if imu else []),
            str(row.wrong_instrument),
            str(row.misled),
        ]
        for row in own
    ]
    yield from _table(head, "l" + "r" * (len(head) - 1), body)


def _flights(group: Json) -> Iterator[str]:
    first = next((p for p in group["configurations"] if p["cells"]), None)
    said = group["thresholds"]
    yield f"{said[0].upper()}{said[1:]}. Profile `{group['profile']}`."
    if first is not None:
        yield (
            "Flights: "
            + "; ".join(f"{f['name']} ({f['duration_s'] / 60:.1f} min)" for f in first["flights"])
            + "."
        )
    for part in group["configurations"]:
        for flight in part["flights"]:
            if not flight["trials"] and part["cells"]:
                yield (
                    f"No trial of {part['configuration']} is in {flight['name']}: no time in which "
                    "its sensors are judged leaves a longest window."
                )
    yield ""


def _how(document: Json) -> str:
    trials = document["trials"]
    enough = trials - misses_allowed(trials)
    return _HOW.format(
        quick="The quick form: few trials and four of an IMU's six axes.\n\n"
        if document["quick"]
        else "",
        trials=trials,
        enough=enough,
        longest=f"{max(document['windows_s']):g}",
        aftermath=f"{AFTERMATH_S:g}",
        all_share=f"{100 * share_lower(trials, trials):.0f}",
        enough_share=f"{100 * share_lower(enough, trials):.0f}",
    )


def _table(
    head: Sequence[str], align: str, body: Iterator[Sequence[str]] | Sequence[Sequence[str]]
) -> Iterator[str]:
    yield "| " + " | ".join(head) + " |"
    yield "|" + "|".join("---:" if a == "r" else "---" for a in align) + "|"
    for line in body:
        yield "| " + " | ".join(line) + " |"
    yield ""


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
