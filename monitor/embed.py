"""The monitor as a part of another program: bytes or samples in, verdicts and estimates out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from links.mavlink import Decoder, Vehicle
from links.samples import Batch
from links.vocabulary import Rejection
from monitor.pipeline import Pipeline
from monitor.settings import Settings, load
from monitor.verdict import StepResult, Verdict

__all__ = ["Monitor"]


class Monitor:
    """Watches the sensors of one vehicle.

    It opens nothing, sends nothing and reads no clock: the vehicle's own time drives it, so that it
    says the same of a live link and of its recording, however the stream is cut. What comes in is
    never an exception: what cannot be used is counted (:attr:`rejected`). It belongs to one thread
    at a time.

    The first use on a machine compiles for some minutes; :func:`monitor.warm_up` does it ahead.

    Parameters
    ----------
    settings
        The configuration; None takes that of :func:`monitor.load_settings`.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self._settings = load() if settings is None else settings
        self._decoder = Decoder(self._settings.links.decoder_options())
        self._pipeline = Pipeline(self._settings)
        self._fed: type | None = None

    @property
    def settings(self) -> Settings:
        """The configuration."""
        return self._settings

    @property
    def vehicle(self) -> Vehicle | None:
        """Who is watched; None until MAVLink bytes told."""
        return self._decoder.vehicle

    @property
    def now_us(self) -> int:
        """Vehicle time up to which everything has been judged [us]."""
        return self._pipeline.now_us

    @property
    def flying(self) -> bool:
        """Whether the aircraft is seen to fly; sensors are judged in flight only."""
        return self._pipeline.flying

    @property
    def states(self) -> Mapping[str, Verdict]:
        """Sensor -> its standing verdict, the last one that was said of it."""
        return self._pipeline.states()

    @property
    def rejected(self) -> Counter[tuple[str, Rejection]]:
        """What was not used: (sensor or ``"frame"``, reason) -> count."""
        return self._pipeline.rejected

    def feed(self, data: bytes | Batch) -> StepResult:
        """Use what has arrived; say what it changed.

        Samples wait for others that may come late, so what is said now is mostly of earlier ones:
        ``streams.horizon_s`` of the settings says how long.

        Parameters
        ----------
        data
            MAVLink bytes, cut anywhere; or samples, of :func:`monitor.open_log` or
            :class:`monitor.ArraySource`. A monitor takes one of the two all its life, since the
            samples of a stream are numbered.

        Returns
        -------
        StepResult
            Changes of state in time order, and new estimates; mostly empty.

        Raises
        ------
        TypeError
            Bytes after samples, samples after bytes, or neither.
        """
        kind = Batch if isinstance(data, Batch) else bytes
        if kind is bytes and not isinstance(data, bytes):
            raise TypeError(f"a monitor is fed bytes or a Batch, not {type(data).__name__}")
        if self._fed not in (None, kind):
            raise TypeError("a monitor that was fed bytes takes no Batch, nor the other way round")
        self._fed = kind
        return self._use(data if isinstance(data, Batch) else self._decoder.feed(data))

    def finish(self) -> StepResult:
        """Use all that still waits: the stream has ended, and nothing is fed any more.

        Returns
        -------
        StepResult
            The last changes of state and estimates.
        """
        last = [] if self._fed is Batch else [self._use(self._decoder.finish())]
        with np.errstate(all="ignore"):
            last.append(self._pipeline.finish())
        out = StepResult()
        for result in last:
            out.verdicts += result.verdicts
            for name, rows in result.estimates.items():
                held = out.estimates.get(name)
                out.estimates[name] = rows if held is None else np.concatenate((held, rows))
        return out

    def _use(self, batch: Batch) -> StepResult:
        # What a sensor sends may be no number at all: it is rejected, not complained about.
        with np.errstate(all="ignore"):
            return self._pipeline.feed(batch)
