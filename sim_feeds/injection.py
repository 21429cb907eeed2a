"""Open-loop fault injection into recorded flights (lu2016 section 3.2): what a recorded sensor
would have sent had it been broken.

An :class:`Injection` is a list of faults, read from a file whose ``[[fault]]`` tables are those of
scenarios; times are seconds from the log's first record, as ``summary.json`` counts. The aircraft
flies as it flew: no autopilot steers on the faulty readings, as it would in flight.

Two ways in, one core (:mod:`sim_feeds.injection_core`): a :class:`RowInjector` changes decoded
rows, which is how many injections into one flight are tried fast; a
:class:`~sim_feeds.injection_frames.FrameInjector` changes the frames of a log.
::

    log = open_log("flight.tlog")
    flight = Batch.concatenate(log)                                  # decoded once
    for start_s in range(100, 200, 10):
        fault = Fault("airspeed0", FaultKind.SCALE, start_s, size=0.3)
        injector = RowInjector(Injection([fault]), seed=1, first_us=log.info.first_t_us)
        pipeline.feed(injector.apply(flight))                        # a new pipeline each time
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from links.catalog import SOURCES
from links.samples import Batch, Rows, quantity_of
from links.vocabulary import Rejection
from sim_feeds.attitude_follow import AttitudeFollows
from sim_feeds.fault_table import FaultEntry
from sim_feeds.faults import Fault
from sim_feeds.injection_core import InjectionCore
from sim_feeds.section import ScenarioError, Strict, parse_table

__all__ = ["EXAMPLE", "Injection", "RowInjector", "load_injection", "parse_injection"]

EXAMPLE: Final = """\
# Times are seconds from the log's first record, as in summary.json.
[[fault]]
sensor = "airspeed0"       # reads 30 % high for a minute
kind = "scale"
fraction = 0.3
start_s = 120.0
end_s = 180.0

[[fault]]
sensor = "imu0.gyro_x"     # and a gyro that is 3 deg/s off until the end
kind = "bias"
size_deg_s = 3.0
start_s = 200.0

[attitude]                 # the autopilot's attitude comes from this gyro
follows = true
"""


@dataclass(frozen=True, slots=True)
class Injection:
    """What breaks in a recorded flight.

    Attributes
    ----------
    faults
        In SI; their times are seconds from the log's first record.
    attitude
        How the autopilot's attitude follows a faulty IMU; None leaves it as recorded.
    """

    faults: Sequence[Fault] = ()
    attitude: AttitudeFollows | None = None

    @property
    def sensors(self) -> list[str]:
        """Sensors with a fault of their own (``imu0``, not its axis), each once."""
        return list(dict.fromkeys(f.sensor.partition(".")[0] for f in self.faults))


class _Attitude(Strict):
    """How the autopilot's attitude follows; see :mod:`sim_feeds.attitude_follow`."""

    follows: bool = True
    imu: int = Field(0, ge=0, le=4, description="Number of the IMU that it is computed from.")
    time_constant_s: float = Field(
        5.0,
        gt=0.0,
        description="Of the pull to the accelerometers (1 / AHRS_RP_P).",
    )
    heading_time_constant_s: float = Field(
        5.0, gt=0.0, description="Of the pull to the compass (1 / AHRS_YAW_P)."
    )


class _InjectionFile(Strict):
    title: str = ""
    fault: tuple[FaultEntry, ...] = ()
    attitude: _Attitude | None = None

    @model_validator(mode="after")
    def _only_sensors(self) -> _InjectionFile:
        for f in self.fault:
            if f.quantity in ("wing", "engine"):
                raise ValueError(
                    f"{f.sensor} cannot break in a flight that is over; its sensors can"
                )
        return self

    @model_validator(mode="after")
    def _follows_a_fault(self) -> _InjectionFile:
        follows = self.attitude
        if follows is None or not follows.follows or not self.fault:
            return self
        if not any(f.sensor.startswith(f"imu{follows.imu}.") for f in self.fault):
            raise ValueError(
                f"the attitude is to follow imu{follows.imu}, which has no fault to follow"
            )
        return self

    def injection(self) -> Injection:
        a = self.attitude
        follows = (
            AttitudeFollows(a.imu, a.time_constant_s, a.heading_time_constant_s)
            if a is not None and a.follows
            else None
        )
        return Injection(tuple(f.fault() for f in self.fault), follows)


def load_injection(path: str | Path) -> Injection:
    """Read and validate a file of faults.

    Raises
    ------
    ScenarioError
        The file cannot be read, is no TOML, or a value in it does not fit.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(
            f"cannot read {path}: {error.strerror}; `mavsentry inject --example` prints one to "
            "begin with"
        ) from error
    except UnicodeDecodeError:
        raise ScenarioError(f"{path} is no TOML: it is not text") from None
    return parse_injection(text, str(path))


def parse_injection(text: str, where: str = "faults") -> Injection:
    """Validate the text of a file of faults; errors begin with ``where``."""
    return parse_table(text, _InjectionFile, where).injection()


class RowInjector:
    """Breaks sensors in a stream of decoded batches; where it is cut changes nothing.

    A reading that the fault takes out of the bounds of :mod:`links.catalog` is rejected, as a
    decoder does. Unlike in a message, nothing saturates or is rounded.

    Parameters
    ----------
    injection
        What breaks.
    seed
        Of the noise.
    first_us
        Vehicle time of the log's first record, ``LogInfo.first_t_us`` [us].
    """

    def __init__(self, injection: Injection, seed: int = 0, first_us: int = 0) -> None:
        self._core = InjectionCore(injection.faults, injection.attitude, seed, first_us)

    def apply(self, batch: Batch) -> Batch:
        """The batch as it would have been; rows of other sensors are shared, not copied."""
        rows, rejected = dict(batch.rows), batch.rejected.copy()
        shown = {(s, 0): r for s, r in rows.items() if s in self._core.needs}
        for (sensor, _), (changed, keep) in self._core.apply(shown).items():
            good = keep & _within_bounds(sensor, changed)
            if n := int(np.count_nonzero(keep & ~good)):
                rejected[sensor, Rejection.OUT_OF_RANGE] += n
            rows[sensor] = changed if good.all() else changed[good]
        return Batch({s: r for s, r in rows.items() if len(r)}, rejected)


@lru_cache(maxsize=64)
def _bounds(quantity: str) -> dict[str, tuple[float, float]]:
    """Field of a quantity's rows -> bounds that a reading must keep, from the catalogue."""
    return {
        fill.into: (fill.low, fill.high)
        for source in SOURCES
        if source.quantity == quantity
        for fill in source.fills
        if fill.required and (fill.low > -inf or fill.high < inf)
    }


def _within_bounds(sensor: str, rows: Rows) -> NDArray[np.bool_]:
    good = np.ones(len(rows), np.bool_)
    for name, (low, high) in _bounds(quantity_of(sensor)).items():
        values = rows[name]
        outside = (values < low) | (values > high)
        good &= ~(outside if outside.ndim == 1 else outside.any(axis=1))
    return good
