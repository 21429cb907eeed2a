"""Draws the pictures of the documentation from the bundled scenarios.

``python docs/pictures.py`` flies the demo scenario, judges its telemetry with the pipeline and
writes ``docs/pictures/*.png``. Needs matplotlib.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np

from links.mavlink import Decoder
from links.samples import Batch
from monitor import settings, summary
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from sim_feeds import player, scenario

PICTURES = Path(__file__).parent / "pictures"
MEASURED, TRUE, RECONSTRUCTED, FAULT = "#b3261e", "#000000", "#1f5fa8", "#f6d6d3"


def judge(name: str) -> tuple[Any, Batch, Recording, list[dict[str, Any]]]:
    """Flight, samples, what the pipeline said, and the faults in seconds of vehicle time."""
    flight = scenario.load(name).fly()
    decoder, recording = Decoder(), Recording()
    batch = Batch.concatenate(
        [decoder.feed(b"".join(f for _, f in player.frames_of(flight))), decoder.finish()]
    )
    pipeline = Pipeline(settings.load("transport"))
    recording.add(pipeline.feed(batch))
    recording.add(pipeline.finish())
    return flight, batch, recording, summary.faults(recording.verdicts, first_us=0)


def caught(path: Path) -> None:
    """One pitot runs away: measured, reconstructed, true, and when it was said."""
    flight, batch, recording, faults = judge("demo")
    fault = next(f for f in faults if f["sensor"] == "airspeed1")
    air, pitot = recording.estimates["air"], batch.rows["airspeed1"]
    begin, end = fault["onset_s"] - 15, (fault["cleared_s"] or fault["detected_s"] + 30) + 8

    figure, axes = plt.subplots(figsize=(9, 3.6), layout="constrained")
    axes.axvspan(fault["detected_s"], fault["cleared_s"] or end, color=FAULT, lw=0)
    t = air["t_us"] / 1e6
    inside = (t > begin) & (t < end)
    cas, std = air["cas_m_s"][inside], air["cas_std_m_s"][inside]
    axes.fill_between(
        t[inside], cas - 2 * std, cas + 2 * std, color=RECONSTRUCTED, alpha=0.25, lw=0
    )
    axes.plot(t[inside], cas, color=RECONSTRUCTED, label="reconstructed, 2 sigma")
    t = pitot["t_us"] / 1e6
    inside = (t > begin) & (t < end)
    axes.plot(t[inside], pitot["cas_m_s"][inside], color=MEASURED, lw=1, label="airspeed1 reads")
    truth = player.truth(flight)
    t_true, true = truth["t_us"] / 1e6, truth["cas_m_s"]
    inside = (t_true > begin) & (t_true < end)
    axes.plot(t_true[inside], true[inside], color=TRUE, lw=1, ls="--", label="true")
    axes.annotate(
        f"FAULTY after {fault['detected_s'] - fault['onset_s']:.1f} s",
        (fault["detected_s"], axes.get_ylim()[1]),
        xytext=(6, -14),
        textcoords="offset points",
        color=MEASURED,
    )
    axes.set(xlabel="vehicle time [s]", ylabel="calibrated airspeed [m/s]", xlim=(begin, end))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    PICTURES.mkdir(exist_ok=True)
    caught(PICTURES / "pitot-runaway.png")
