"""Bundled scenarios, flown and judged by the pipeline; what the pitot bank weighed meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d_bank import N_HYPOTHESES, survey
from estimators.air_data_3d_state import T_EPOCH
from links.mavlink import Decoder
from links.samples import Batch
from monitor import settings, summary
from monitor.pipeline import Pipeline
from monitor.recording import Recording
from monitor.verdict import Verdict
from monitor.watch.air import AirWatch
from sim_feeds import player, scenario

SLICE_US, WHOLE_US = 200_000, 30_000_000


@dataclass(frozen=True)
class Judged:
    """A flight, its samples, and all that was said of them; times [s] from the first frame.

    Attributes
    ----------
    first_us
        Vehicle time of the first frame [us].
    faults
        As in ``summary.json``.
    bank
        Columns ``t_s``, ``evidence`` (n, 8) of each explanation over "nothing happened" [nat],
        and of the bank's master ``x`` (n, 10) and ``P`` (n, 10, 10).
    """

    flight: Any
    batch: Batch
    recording: Recording
    first_us: int
    faults: list[dict[str, Any]]
    bank: dict[str, NDArray[np.float64]]

    def seconds(self, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """Vehicle time as seconds from the first frame."""
        seconds: NDArray[np.float64] = (t_us - self.first_us) / 1e6
        return seconds

    def rows(self, sensor: str, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times and values of what a sensor sent."""
        rows = self.batch.rows[sensor]
        return self.seconds(rows["t_us"]), rows[column]

    def estimate(self, table: str, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times and values of a column of estimates."""
        rows = self.recording.estimates[table]
        return self.seconds(rows["t_us"]), rows[column]

    def truth(self, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times and values of the truth."""
        table = player.truth(self.flight)
        return self.seconds(table["t_us"]), table[column]

    def verdicts(self, sensor: str) -> list[Verdict]:
        """Its changes of state."""
        return [v for v in self.recording.verdicts if v.sensor == sensor]

    def fault(self, sensor: str) -> dict[str, Any]:
        """The first fault found in a sensor."""
        return next(f for f in self.faults if f["sensor"] == sensor)


@cache
def judged(
    name: str,
    profile: str = "small-uav",
    change: Callable[[dict[str, Any]], None] | None = None,
    weigh: bool = False,
) -> Judged:
    """Fly a bundled scenario, changed or not, and let the air watch judge it.

    With ``weigh`` piece by piece, and ``bank`` has what it held after each.
    """
    flight = scenario.load(name, change).fly()
    chosen = settings.load(profile)
    watch = AirWatch(chosen.air, chosen.triplex, chosen.vane)
    pipeline, recording, decoder = Pipeline(chosen, [watch]), Recording(), Decoder()
    batches: list[Batch] = []
    bank: list[tuple[float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]] = []
    frames = list(player.frames_of(flight))
    first_us = frames[0][0]
    slice_us = SLICE_US if weigh else WHOLE_US
    for _, some in groupby(frames, lambda frame: frame[0] // slice_us):
        batches.append(decoder.feed(b"".join(frame for _, frame in some)))
        recording.add(pipeline.feed(batches[-1]))
        bank.append(_weighed(watch, first_us))
    batches.append(decoder.finish())
    recording.add(pipeline.feed(batches[-1]))
    recording.add(pipeline.finish())
    t_s, evidence, x, P = (np.array(column) for column in zip(*bank, strict=True))
    return Judged(
        flight,
        Batch.concatenate(batches),
        recording,
        first_us,
        summary.faults(recording.verdicts, first_us=first_us),
        {"t_s": t_s, "evidence": evidence, "x": x, "P": P},
    )


def _weighed(
    watch: AirWatch, first_us: int
) -> tuple[float, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """What the pitot bank holds of its explanations now."""
    inside = watch._bank
    state, bank = inside._state, inside._state.bank
    top, where = np.empty(N_HYPOTHESES), np.empty(N_HYPOTHESES, np.int64)
    since_s = state.memory[T_EPOCH]
    survey(bank, inside._params.limits.wind, since_s, top, where)
    t_s = since_s + ((inside._epoch_us or first_us) - first_us) / 1e6
    return t_s, top, bank.x.copy(), bank.P.copy()
