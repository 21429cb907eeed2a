"""lu2016 section 5 on recordings: tables, the figures 8 to 12 redrawn, and claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import GYRO_ACC_AXES
from monitor.commands.reproduce.lu2016.published import (
    AXES,
    COLUMNS,
    PARABOLIC_GYRO_RAD_S,
    shown,
)
from monitor.commands.reproduce.lu2016.recorded_claims import claims
from monitor.commands.reproduce.lu2016.recorded_names import (
    FOLLOWED,
    FORMS,
    OWN_TIMES,
    PAPER,
    PAPER_FAST,
    PIPELINE,
    PIPELINE_FOLLOWED,
    flights_of,
    median_of,
    overall,
    spread,
    swing,
)
from monitor.commands.reproduce.study import Figure, Result, Scope, Table, Text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["blocks", "claims"]

Floats = NDArray[np.float64]

_FIGURES: Final = ("9", "10", "11")
_COLOURS: Final = {PAPER: "C0", OWN_TIMES: "C2", PIPELINE: "C1", FOLLOWED: "C3"}


def blocks(results: Mapping[str, Result], scope: Scope) -> list[Table | Figure | Text]:
    """Section 5, as far as the recordings are there."""
    flights = flights_of(results)
    if not flights:
        return [
            Text(
                "Recorded flights",
                "Not run: no recordings were given (a folder with `alfa/*.tlog`).",
            )
        ]
    first = flights[0]
    found: list[Table | Figure | Text] = [
        Text("Recordings of a small aircraft", _words(flights)),
        _flights_table(flights),
        _errors_table(flights),
        _late_table(flights),
        _beside_table(flights),
        _figure_8(first),
    ]
    for number, r in zip(_FIGURES, flights, strict=False):
        found.append(_figure_9(r, number))
    found += [_figure_12(flights), _figure_followed(flights[-1])]
    found += [_healthy_table(flights), _named_table(flights)]
    return found


def _words(flights: Sequence[Result]) -> str:
    onsets = sum(len(r["onsets"]) for r in flights)
    apart = max(float(np.max(shown(v))) for r in flights for v in r["file"]["apart"].values())
    return (
        "The paper writes its faults into three recordings of a Cessna Citation. Here Table 2 is "
        f"written into {len(flights)} recordings of a 2 kg aircraft (ALFA), {onsets} onsets in "
        "all, by the core of `mavsentry inject`; 20 s of faults, scored with 10 s before and "
        "after. By way of a file, where MAVLink rounds to a milli-g and a milliradian per second, "
        f"estimates differ by at most {apart:.3f} m/s² or deg/s.\n\n"
        "A small autopilot records a tenth of the paper's rates, no flow angles (the airspeed "
        "model cannot be run: it is compared on synthetic recordings) and no vertical GPS speed. "
        "Its sensors have turn-on biases that no one injected, so errors are counted against what "
        "the same form says of the healthy recording; the table of healthy recordings has these. "
        "“Interpolated” is the paper's form (“mended”: without the division of (53) by dt, which "
        "contradicts (46), and without the dt² of (57)), “own times” what can be done in flight, "
        "“pipeline” the monitor."
    )


def _flights_table(flights: Sequence[Result]) -> Table:
    rows: list[list[Any]] = []
    for r in flights:
        f = r["flight"]
        rows.append(
            [
                f["name"],
                len(r["onsets"]),
                f["used_s"],
                "{:.0f} to {:.0f}".format(*f["speed_m_s"]),
                "{:.0f} to {:.0f}".format(*f["az_m_s2"]),
                f["roll_deg"],
                f["roll_rate_deg_s"],
                "{imu_hz:.0f} / {attitude_hz:.1f} / {gps_hz:.0f}".format(**f),
                float(f["noise"][2]),
                float(np.degrees(f["noise"][3])),
            ]
        )
    return Table(
        "lu2016-recorded-flights",
        "The recordings. The paper's: level, parabolic (A_z 0 to -20 m/s²) and turbulent, IMU and "
        "attitude at 100 Hz, GPS at 1 Hz.",
        (
            "recording",
            "onsets",
            "healthy until [s]",
            "ground speed [m/s]",
            "A_z [m/s²]",
            "bank [deg]",
            "roll rate [deg/s]",
            "IMU / attitude / GPS [Hz]",
            "noise of A_z [m/s²]",
            "noise of p [deg/s]",
        ),
        rows,
    )


def _errors_table(flights: Sequence[Result]) -> Table:
    rows: list[list[Any]] = []
    for r in flights:
        for form in FORMS:
            errors = shown(median_of(r, form, "rmse"))
            rows.append([r["flight"]["name"], form, *map(float, errors)])
    return Table(
        "lu2016-recorded",
        "Figs. 9-11(e, f): RMSE of the fault estimates over 40 s, less the healthy recording's; "
        "median of the onsets. The paper shows bars without numbers.",
        ("recording", "form", *COLUMNS),
        rows,
        digits=2,
    )


def _late_table(flights: Sequence[Result]) -> Table:
    rows: list[list[Any]] = []
    for form in FORMS:
        share = overall(flights, form, "share_late")
        out, delay_s = swing(flights, form)
        rows.append([form, *(100.0 * float(s) for s in share), 100.0 * out, delay_s])
    return Table(
        "lu2016-recorded-late",
        "From 5 s after the onset on: rms error as a share of the rms fault, in percent; median of "
        "all onsets of all recordings. 100 is what no estimate at all would have. Then the "
        "amplitude of the oscillating f_Az and its delay.",
        ("form", *(f"{a} [%]" for a in AXES), "f_Az amplitude [%]", "f_Az delay [s]"),
        rows,
        digits=2,
    )


def _beside_table(flights: Sequence[Result]) -> Table:
    """Ours beside what the paper's text says of its recordings."""
    agile = max(flights, key=lambda r: r["flight"]["roll_rate_deg_s"])
    gyro = float(np.max(median_of(agile, PAPER, "largest")[3:]))
    ratio = spread(flights, PAPER)
    fast, slow = (overall(flights, form, "rmse")[2] for form in (OWN_TIMES, _slow(OWN_TIMES)))
    drawn_fast, drawn_slow = (overall(flights, form, "rmse")[0] for form in (_fast(PAPER), PAPER))
    return Table(
        "lu2016-recorded-beside",
        "What the text of section 5 says, beside ours in the paper's form.",
        ("what", "ours", "paper", "why they differ"),
        [
            [
                "largest error of a rate fault in the most agile flight [rad/s]",
                gyro,
                f"< {PARABOLIC_GYRO_RAD_S:g}",
                "At its onset f_r is 3 deg/s = 0.052 rad/s, and an attitude every 0.4 s cannot "
                "show it before the next: the error begins with the whole fault.",
            ],
            [
                "RMSE of f_Ax, largest over smallest of the flights",
                float(ratio[0]),
                "similar (Fig. 12)",
                "No difference." if ratio[0] < 1.5 else "The recordings differ in their turns.",
            ],
            [
                "RMSE of f_Az with GPS at 5 Hz over that at 1 Hz, measurements at their own times",
                float(fast / slow),
                "better when faster",
                "In flight a fix a second leaves a quarter of the oscillation's period unseen.",
            ],
            [
                "RMSE of f_Ax with GPS at 5 Hz over that at 1 Hz, interpolated",
                float(drawn_fast / drawn_slow),
                "better when faster",
                "A line drawn to the next fix lets the filter see a second ahead: off line that "
                "makes up for the slow receiver, in flight it cannot be had.",
            ],
        ],
        digits=2,
    )


def _slow(form: str) -> str:
    return form.replace("5 Hz", "1 Hz")


def _fast(form: str) -> str:
    return form.replace("1 Hz", "5 Hz")


def _healthy_table(flights: Sequence[Result]) -> Table:
    rows: list[list[Any]] = []
    for r in flights:
        for form in (PAPER, OWN_TIMES, PIPELINE):
            told = r["healthy"][form]
            for what in ("mean", "std"):
                rows.append([r["flight"]["name"], form, what, *map(float, shown(told[what]))])
    return Table(
        "lu2016-recorded-healthy",
        "What is said of the recordings as they are. The means are turn-on biases and misalignment "
        "of a small IMU, found by all forms alike; the paper's sensors have none to speak of.",
        ("recording", "form", "of the estimate", *COLUMNS),
        rows,
        digits=2,
    )


def _named_table(flights: Sequence[Result]) -> Table:
    rows: list[list[Any]] = []
    for key, axis in (*((f"imu0.{a}", a) for a in GYRO_ACC_AXES), ("imu1", "imu1, wrongly")):
        cells: list[Any] = [axis]
        for where in ("named", "named_followed"):
            delays = [o[where][key] for r in flights for o in r["onsets"]]
            times = [d for d in delays if d is not None]
            cells += [100.0 * len(times) / len(delays), float(np.median(times)) if times else None]
        rows.append(cells)
    return Table(
        "lu2016-recorded-named",
        "Not in the paper: axes of imu0 that the monitor calls faulty while all six are, share of "
        "the onsets and median delay; and how often it blames the healthy imu1.",
        (
            "axis",
            "named [%]",
            "after [s]",
            "named, attitude follows [%]",
            "after, attitude follows [s]",
        ),
        rows,
        digits=2,
    )


# ----------------------------------------------------------------------------- figures


def _figure_8(r: Result) -> Figure:
    return Figure(
        "lu2016-fig8-recorded",
        f"Fig. 8(c, d) on the recording “{r['flight']['name']}”: measured less estimated states, "
        "interpolated form; faults from 0 to 20 s (shaded).",
        lambda canvas: _draw_residuals(canvas, r["lines"][PAPER]),
        (8.0, 2.8),
    )


def _draw_residuals(canvas: Canvas, line: Mapping[str, Any]) -> None:
    left, right = canvas.subplots(1, 2, sharex=True)
    for k, name in enumerate(("$U_N$", "$U_E$", "$U_D$")):
        left.plot(line["t_s"], line["residual"][:, k], label=name)
    for k, name in enumerate((r"$\phi$", r"$\theta$", r"$\psi$")):
        right.plot(line["t_s"], np.degrees(line["residual"][:, 3 + k]), label=name)
    for axis, title in ((left, "velocities [m/s]"), (right, "angles [deg]")):
        axis.set_title(title)
        axis.set_xlabel("time from the onset [s]")
        axis.axvspan(0.0, 20.0, color="0.95", lw=0)
        axis.legend(ncols=3)


def _figure_9(r: Result, number: str) -> Figure:
    name = r["flight"]["name"]
    return Figure(
        f"lu2016-fig{number}-recorded",
        f"Fig. {number}(a, b) on the recording “{name}”: injected faults (grey) and their "
        "estimates, less what the same form says of the healthy recording.",
        lambda canvas: _draw_faults(canvas, r["lines"], (PAPER, OWN_TIMES, PIPELINE)),
        (8.0, 4.6),
    )


def _figure_followed(r: Result) -> Figure:
    name = r["flight"]["name"]
    return Figure(
        "lu2016-followed",
        f"Not in the paper: the same recording (“{name}”) with the attitude that the autopilot "
        "would have computed from the broken IMU, against the attitude of its own.",
        lambda canvas: _draw_faults(canvas, r["lines"], (PAPER, FOLLOWED)),
        (8.0, 4.6),
    )


def _draw_faults(canvas: Canvas, lines: Mapping[str, Any], forms: Sequence[str]) -> None:
    axes = canvas.subplots(2, 3, sharex=True)
    for k, axis in enumerate(axes.flat):
        first = lines[forms[0]]
        axis.axvspan(0.0, 20.0, color="0.95", lw=0)
        axis.plot(first["t_s"], shown(first["true"])[:, k], color="0.6", lw=2.2, label="injected")
        for form in forms:
            line = lines[form]
            own = shown(line["f"] - line["healthy"])[:, k]
            axis.plot(line["t_s"], own, color=_COLOURS[form], lw=1.0, label=form)
        axis.set_title(COLUMNS[k])
    for axis in axes[1]:
        axis.set_xlabel("time from the onset [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2)


def _figure_12(flights: Sequence[Result]) -> Figure:
    return Figure(
        "lu2016-fig12-recorded",
        "Fig. 12: RMSE of f_Ax in the recordings, by form; bars are medians of the onsets. The "
        "paper's second bar, the airspeed model, needs flow angles that these flights lack.",
        lambda canvas: _draw_bars(canvas, flights),
        (8.0, 2.8),
    )


def _draw_bars(canvas: Canvas, flights: Sequence[Result]) -> None:
    axis = canvas.subplots()
    forms = [form for form in FORMS if form != PAPER_FAST]
    width = 0.8 / len(forms)
    for k, form in enumerate(forms):
        heights = [median_of(r, form, "rmse")[0] for r in flights]
        hatch = "//" if form in (FOLLOWED, PIPELINE_FOLLOWED) else None
        at = np.arange(len(flights)) + (k - 0.5 * len(forms) + 0.5) * width
        axis.bar(at, heights, width, label=form, color=f"C{k}", hatch=hatch)
    axis.set_xticks(range(len(flights)), [r["flight"]["name"] for r in flights])
    axis.set_ylabel("RMSE of f_Ax [m/s²]")
    canvas.legend(loc="outside right center")
