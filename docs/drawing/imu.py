"""Picture of ``estimators/imu-bank.md``: a difference says that, the filters whose."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from drawing.style import FAULT, GREY, MEASURED, RECONSTRUCTED, canvas, save
from links.mavlink import Decoder
from links.samples import Batch
from monitor import settings, summary
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.watch.imu import ImuWatch
from sim_feeds import player, scenario

FLIGHT: Final = "small-uav-imu-bias"
BEGIN_S, END_S = 120.0, 180.0
MEAN_S: Final = 0.2


def two(path: Path) -> None:
    """Imu0's acc_x steps away from imu1's, is named, and believed again once it is whole."""
    decoder, recording = Decoder(), Recording()
    frames = list(player.frames_of(scenario.load(FLIGHT).fly()))
    first_us = frames[0][0]
    batch = Batch.concatenate([decoder.feed(b"".join(f for _, f in frames)), decoder.finish()])
    chosen = settings.load("small-uav")
    pipeline = Pipeline(chosen, [ImuWatch(chosen.imu)])
    recording.add(pipeline.feed(batch))
    recording.add(pipeline.finish())
    found = summary.faults(recording.verdicts, first_us=first_us)
    fault = next(f for f in found if f["sensor"] == "imu0.acc_x")

    figure, (above, middle, below) = canvas(6.2, 3, sharex=True)
    edges = np.arange(BEGIN_S, END_S, MEAN_S)
    means = []
    for imu in ("imu0", "imu1"):
        rows = batch.rows[imu]
        t = (rows["t_us"] - first_us) / 1e6
        n, _ = np.histogram(t, edges)
        total, _ = np.histogram(t, edges, weights=rows["acc_m_s2"][:, 0])
        means.append(total / np.maximum(n, 1))
    above.plot(edges[:-1], means[0] - means[1], color=MEASURED, lw=1)
    above.set(ylabel="m/s²", title="acc_x: imu0 less imu1, means over 0.2 s")

    for imu, colour in (("imu0", MEASURED), ("imu1", RECONSTRUCTED)):
        rows = recording.estimates[imu]
        t = (rows["t_us"] - first_us) / 1e6
        inside = (t > BEGIN_S) & (t < END_S)
        f, std = rows["acc_fault_m_s2"][inside, 0], rows["acc_fault_std_m_s2"][inside, 0]
        middle.plot(t[inside], f, color=colour, label=imu)
        middle.fill_between(t[inside], f - std, f + std, color=colour, alpha=0.2, lw=0)
    middle.set(ylabel="m/s²", title="estimated fault of acc_x, 1 sigma")
    middle.legend(loc="center", ncols=2)

    rows = recording.estimates["imu0_tests"]
    t = (rows["t_us"] - first_us) / 1e6
    inside = (t > BEGIN_S) & (t < END_S)
    below.plot(t[inside], rows["acc_x_ratio"][inside], color=MEASURED)
    below.axhline(1.0, color=GREY, lw=1, ls=":")
    below.set(
        xlabel="time [s]", title="imu0.acc_x: statistic over threshold", xlim=(BEGIN_S, END_S)
    )
    for panel in (above, middle, below):
        panel.axvspan(fault["detected_s"], fault["cleared_s"], color=FAULT, lw=0, zorder=0)
    said = f"FAULTY {fault['detected_s'] - fault['onset_s']:.1f} s after onset"
    above.annotate(
        said, (fault["detected_s"], 0.5), xycoords=("data", "axes fraction"), va="top",
        xytext=(4, 0), textcoords="offset points", color=MEASURED,
    )  # fmt: skip
    save(figure, path)
