"""The picture on the README's first screen: a pitot of a transport runs away."""

from __future__ import annotations

from pathlib import Path

from drawing.flights import judged
from drawing.style import FAULT, MEASURED, RECONSTRUCTED, TRUE, canvas, save


def caught(path: Path) -> None:
    """One pitot runs away: measured, reconstructed, true, and when it was said."""
    flight = judged("demo", "transport")
    fault = flight.fault("airspeed1")
    begin, end = fault["onset_s"] - 15, (fault["cleared_s"] or fault["detected_s"] + 30) + 8

    figure, (axes,) = canvas(3.2)
    axes.axvspan(fault["detected_s"], fault["cleared_s"] or end, color=FAULT, lw=0)
    t, cas = flight.estimate("air", "cas_m_s")
    _, std = flight.estimate("air", "cas_std_m_s")
    inside = (t > begin) & (t < end)
    t, cas, std = t[inside], cas[inside], std[inside]
    axes.fill_between(t, cas - 2 * std, cas + 2 * std, color=RECONSTRUCTED, alpha=0.25, lw=0)
    axes.plot(t, cas, color=RECONSTRUCTED, label="reconstructed, 2 sigma")
    for (t, cas), colour, line, name in (
        (flight.rows("airspeed1", "cas_m_s"), MEASURED, "-", "airspeed1 reads"),
        (flight.truth("cas_m_s"), TRUE, "--", "true"),
    ):
        inside = (t > begin) & (t < end)
        axes.plot(t[inside], cas[inside], color=colour, lw=1, ls=line, label=name)
    axes.annotate(
        f"FAULTY after {fault['detected_s'] - fault['onset_s']:.1f} s",
        (fault["detected_s"], axes.get_ylim()[1]),
        xytext=(6, -14),
        textcoords="offset points",
        color=MEASURED,
    )
    axes.set(xlabel="seconds from the first record", ylabel="calibrated airspeed [m/s]")
    axes.set_xlim(begin, end)
    axes.legend(loc="lower right")
    save(figure, path)
