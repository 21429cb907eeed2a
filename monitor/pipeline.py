"""The one pipeline: sample batches in, verdicts and estimates out.

``run``, ``analyze`` and the tests call :meth:`Pipeline.feed`. It does no I/O and reads no clock;
vehicle time alone drives it, and where a stream is cut into batches changes nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from links.samples import Batch, Rows, quantity_of
from links.vocabulary import Reason, Rejection, State
from monitor.mute import Muting
from monitor.ordering import Ordering
from monitor.phase import PhaseTracker
from monitor.retune import Retuned, blend, value_of, with_values
from monitor.settings import Settings
from monitor.streams import Change, Stream, Streams
from monitor.verdict import StepResult, Tap, Verdict, Watch
from monitor.watch import build_watches

__all__ = ["Pipeline"]

UNHEARD_US = 500_000
"""A pause of the monitor that is shorter is the streams' own [us]."""

_MAX_BOOTS = 1000
_FOREVER = np.iinfo(np.int64).max
_JUDGED = frozenset({State.OK, State.SUSPECT})
_BOOT = "the vehicle has started anew in flight"
_REFERENCES = frozenset({"gps", "attitude"})


class Pipeline:
    """Orders rows, finds the flight phase, routes rows to the watches, keeps every sensor's state.

    Attributes
    ----------
    now_us
        Vehicle time up to which everything has been judged [us].
    rejected
        (sensor or "frame", reason) -> count, of the links and of the ordering.
    boots
        Vehicle times at which the vehicle began anew [us]; the first 1000.
    """

    fleeting: ClassVar = ("_settings", "_taps")
    """Not of what was learnt: see :mod:`monitor.checkpoint.graph`."""

    def __init__(
        self,
        settings: Settings,
        watches: list[Watch] | None = None,
        taps: Sequence[Tap] = (),
    ) -> None:
        streams = settings.streams
        self._settings = settings
        self._ordering = Ordering(
            round(streams.horizon_s * 1e6),
            {"gps": round(streams.gps_latency_s * 1e6)},
            streams.pending_rows,
        )
        self._phase = PhaseTracker(settings.phase)
        self._streams = Streams(streams)
        self._watches = build_watches(settings) if watches is None else watches
        self._taps = taps
        self._judged: dict[str, Verdict] = {}
        self._states: dict[str, Verdict] = {}
        self._booting = False
        self._muting = Muting(settings.mute.sensors)
        self._unsaid: list[Verdict] = []
        self._boots: list[int] = []
        self.boots: list[int] = []
        self._link_rejected: Counter[tuple[str, Rejection]] = Counter()
        self.now_us = self._ordering.watermark_us

    def feed(self, batch: Batch) -> StepResult:
        """Use a batch; return the verdicts and estimates that it made due."""
        self._link_rejected.update(batch.rejected)
        self._boots += batch.boots
        released = self._ordering.feed(batch.rows)
        return self._say(self._step(released, self._ordering.watermark_us))

    def finish(self) -> StepResult:
        """Use all that still waits behind the watermark: the stream has ended."""
        released = self._ordering.finish()
        last = [int(r["t_us"][-1]) + 1 for r in released.values() if len(r)]
        return self._say(self._step(released, max([self.now_us, *last])))

    def resume(self, first_us: int) -> None:
        """Go on in another process, with rows from this time on: the silence before was ours."""
        if first_us - self._ordering.newest_us > UNHEARD_US:
            self._streams.unheard(self._ordering.newest_us, first_us)

    def retune(self, settings: Settings) -> Retuned:
        """Take new settings without losing any state; sensors that they mute fall silent.

        What follows is said with the next :meth:`feed` or :meth:`finish`.

        Returns
        -------
        Retuned
            Keys of the sections that the pipeline works by, other sections are not looked at.
            Those that wait have their old values in :attr:`settings`.
        """
        done = sum((watch.retune(settings) for watch in self._watches), Retuned())
        done += self._streams.retune(settings.streams).under("streams")
        done += self._phase.retune(settings.phase).under("phase")
        mute, muted = blend(self._settings.mute, settings.mute)
        done += muted.under("mute")
        self._unsaid += self._muting.mute(mute.sensors, self.now_us)
        self._settings = with_values(
            self._settings, {key: value_of(settings, key) for key in done.taken}
        )
        return done

    @property
    def settings(self) -> Settings:
        """The settings in force."""
        return self._settings

    @property
    def flying(self) -> bool:
        """Whether the aircraft flies, at ``now_us``."""
        return self._phase.flying

    @property
    def rejected(self) -> Counter[tuple[str, Rejection]]:
        """Rejections counted by (sensor or ``"frame"``, reason)."""
        return self._link_rejected + self._ordering.rejected

    @property
    def streams(self) -> Mapping[str, Stream]:
        """Account of every stream seen."""
        return self._streams.streams

    def states(self) -> Mapping[str, Verdict]:
        """Each sensor's standing verdict; staleness counts before what the watch last said.

        A muted sensor is unmonitored whatever either says.
        """
        return self._muting.said

    def peaks(self) -> dict[str, float]:
        """Settings key -> largest value that the quantity held to it reached on this stream.

        Only while its sensors were judged and not faulty; keys whose test was never made are left
        out. What thresholds are learnt from (:mod:`monitor.learn`).
        """
        out: dict[str, float] = {}
        for watch in self._watches:
            for key, value in watch.peaks().items():
                out[key] = max(out.get(key, value), value)
        return out

    def _say(self, result: StepResult) -> StepResult:
        """A step's result as an operator is to hear it."""
        result.verdicts = [*self._unsaid, *self._muting.hear(result.verdicts)]
        self._unsaid = []
        return result

    def _step(self, released: dict[str, Rows], until_us: int) -> StepResult:
        if not released and until_us <= self.now_us:
            return StepResult()
        changes = self._streams.step(released, until_us)
        boots = [t_us for t_us in self._boots if t_us < until_us]
        # one behind what was released (of stamps that ran ahead of the clock) counts from there on
        phase = self._phase.step(released, [max(t_us, self.now_us) for t_us in boots])
        if boots:
            self._boots = self._boots[len(boots) :]
            self.boots += boots[: _MAX_BOOTS - len(self.boots)]
        if len(phase):
            released["phase"] = phase
        for tap in self._taps:
            tap.step(released)
        for span in self._phase.withheld:
            released = self._withhold(released, span, changes)
        raised: list[Verdict] = []
        estimates: dict[str, Rows] = {}
        for watch in self._watches:
            result = watch.step(released, until_us)
            raised += result.verdicts
            for name, rows in result.estimates.items():
                estimates[name] = (
                    np.concatenate((estimates[name], rows)) if name in estimates else rows
                )
        self.now_us = until_us
        return StepResult(self._compose(raised, changes), estimates)

    def _withhold(
        self,
        released: dict[str, Rows],
        span: tuple[int, int | None],
        changes: list[tuple[int, str, Change]],
    ) -> dict[str, Rows]:
        """Rows without those of a span in which the vehicle starts up anew in flight."""
        from_us, to_us = span
        if from_us >= self.now_us:
            changes.append((from_us, "", Change.BOOTING))
        if to_us is not None:
            phase = released.get("phase")
            ground = phase is not None and bool((phase["t_us"] == to_us).any())
            changes.append((to_us, "", Change.GROUNDED if ground else Change.BOOTED))
        out = {}
        for sensor, rows in released.items():
            if sensor != "phase":
                t_us = rows["t_us"]
                rows = rows[(t_us < from_us) | (t_us >= (_FOREVER if to_us is None else to_us))]
            if len(rows):
                out[sensor] = rows
        return out

    def _compose(
        self, raised: list[Verdict], changes: list[tuple[int, str, Change]]
    ) -> list[Verdict]:
        """Merge what the watches raised with what stopped or came back, in time order."""
        events: list[tuple[int, int, Verdict | tuple[str, Change]]] = [
            (t_us, 0, (sensor, change)) for t_us, sensor, change in changes
        ]
        events += [(v.t_us, 1, v) for v in raised]
        events.sort(key=lambda e: e[:2])
        out: list[Verdict] = []
        for t_us, _, event in events:
            if isinstance(event, Verdict):
                self._judged[event.sensor] = event
                standing = self._states.get(event.sensor)
                if standing is None or standing.state is not State.STALE:
                    out.append(event)
                    self._states[event.sensor] = event
            else:
                for verdict in self._freshness(t_us, *event):
                    out.append(verdict)
                    self._states[verdict.sensor] = verdict
        return out

    def _freshness(self, t_us: int, stream: str, change: Change) -> list[Verdict]:
        """Verdicts on the sensors of a stream that stopped, came back or never says anything."""
        if change is Change.BLANK:
            said = f"{stream} shows nothing: it is not fitted"
            return [Verdict(t_us, stream, State.ABSENT, evidence=said)]
        if change is Change.STOPPED:
            sensors = [s for s in self._states if s.partition(".")[0] == stream]
            return [
                Verdict(t_us, s, State.STALE, evidence=f"{stream} sends no data any more")
                for s in sensors
                if self._states[s].state is not State.ABSENT
            ]
        if change is Change.BOOTING:
            self._booting = True
            return self._suspended(t_us)
        if change is Change.BOOTED:
            self._booting = False
            return self._suspended(t_us)
        if change is Change.GROUNDED:
            self._booting = False
            return []
        if quantity_of(stream) in _REFERENCES:
            return [Verdict(t_us, stream, State.OK)]
        return [
            self._standing(s, t_us)
            for s in self._judged
            if s.partition(".")[0] == stream and self._states[s].state is State.STALE
        ]

    def _suspended(self, t_us: int) -> list[Verdict]:
        """Verdicts on what is judged, as a boot in flight begins or is over."""
        return [
            self._standing(s, t_us)
            for s, judged in self._judged.items()
            if judged.state in _JUDGED and self._states[s].state is not State.STALE
        ]

    def _standing(self, sensor: str, t_us: int) -> Verdict:
        """What the watch says of a sensor; while the vehicle boots in flight, that it cannot."""
        judged = self._judged[sensor]
        if self._booting and judged.state in _JUDGED:
            return Verdict(
                t_us, sensor, State.UNMONITORED, Reason.REFERENCE_MISSING, evidence=_BOOT
            )
        return replace(judged, t_us=t_us)
