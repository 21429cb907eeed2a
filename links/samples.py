"""The sample vocabulary: one structured dtype per physical quantity, SI and radians.

A row's first two fields are always ``seq`` (arrival number over all sensors, from 0) and ``t_us``
(vehicle time, int64 microseconds since boot). The unit of every other field is in its name; frames
are FRD for the body and NED for the earth. A value that a message does not carry is NaN.

A :class:`Batch` maps a sensor name (``imu0``, ``gps1``, ``attitude`` ...) to an array
of such rows in arrival order, and carries what was rejected on the way, counted by reason.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import Rejection

__all__ = ["NO_WORDS", "QUANTITIES", "WORD", "Batch", "Rows", "empty_rows", "quantity_of"]

Rows = NDArray[np.void]

_KEY = [("seq", "<i8"), ("t_us", "<i8")]


def _dtype(*fields: Any) -> np.dtype[np.void]:
    return np.dtype([*_KEY, *fields])


IMU = _dtype(("acc_m_s2", "<f8", (3,)), ("gyro_rad_s", "<f8", (3,)))
ATTITUDE = _dtype(("q_ned_from_frd", "<f8", (4,)), ("rate_rad_s", "<f8", (3,)))
GPS = _dtype(
    ("fix_type", "<i4"),
    ("lat_rad", "<f8"),
    ("lon_rad", "<f8"),
    ("alt_m", "<f8"),
    ("vel_ned_m_s", "<f8", (3,)),
    ("h_std_m", "<f8"),
    ("v_std_m", "<f8"),
    ("vel_std_m_s", "<f8"),
    ("satellites", "<i4"),
    ("stamp_us", "<i8"),
)
NAV = _dtype(
    ("lat_rad", "<f8"),
    ("lon_rad", "<f8"),
    ("alt_m", "<f8"),
    ("height_m", "<f8"),
    ("vel_ned_m_s", "<f8", (3,)),
)
AIRSPEED = _dtype(("cas_m_s", "<f8"), ("diff_press_pa", "<f8"))
BARO = _dtype(("static_press_pa", "<f8"), ("temperature_k", "<f8"))
AOA = _dtype(("aoa_rad", "<f8"))
SPOOL = _dtype(
    ("speed_rpm", "<f8"),
)
SERVO = _dtype(("pwm_us", "<f8", (16,)))
DEMAND = _dtype(("height_error_m", "<f8"), ("airspeed_error_sign", "<f8"))
HEARTBEAT = _dtype(
    ("vehicle_type", "<i4"),
    ("autopilot", "<i4"),
    ("armed", "?"),
    ("autonomous", "?"),
    ("system_status", "<i4"),
)
LANDED = _dtype(("landed_state", "<i4"))
SYS_STATUS = _dtype(("present", "<u4"), ("enabled", "<u4"), ("health", "<u4"))
PARAM = _dtype(("name", "S16"), ("value", "<f8"))
TEXT = _dtype(("severity", "<i4"), ("text", "S50"))
NAMED = _dtype(("name", "S10"), ("value", "<f8"))

QUANTITIES: dict[str, np.dtype[np.void]] = {
    "imu": IMU,
    "attitude": ATTITUDE,
    "gps": GPS,
    "nav": NAV,
    "airspeed": AIRSPEED,
    "baro": BARO,
    "aoa": AOA,
    "spool": SPOOL,
    "servo": SERVO,
    "demand": DEMAND,
    "heartbeat": HEARTBEAT,
    "landed": LANDED,
    "sys_status": SYS_STATUS,
    "param": PARAM,
    "text": TEXT,
    "named": NAMED,
}
"""Quantity -> dtype. A sensor name is a quantity plus an instance number where it has instances.

``nav`` is the autopilot's own position and velocity (GLOBAL_POSITION_INT): it shares the IMU's
faults. ``gps`` velocity has a NaN down component where the receiver's message has none.
``demand`` is what the autopilot wants of height and airspeed less what it sees; of the airspeed the
sign alone, since ArduPlane sends cm/s in NAV_CONTROLLER_OUTPUT where MAVLink says m/s.
``text`` and ``named`` are what *other* components said (never an input of an estimator).
"""

WORD = np.dtype(
    [
        ("t_us", "<i8"),
        ("system", "<i4"),
        ("component", "<i4"),
        ("name", "S10"),
        ("value", "<f8"),
        ("text", "S50"),
    ]
)
"""What another component of the vehicle said, and when it stood in the log.

A named value (``name``, ``value``) or a text (``name`` empty). ``system`` and ``component`` are 0
where the log does not tell who spoke.
"""

NO_WORDS: Rows = np.empty(0, WORD)


def quantity_of(sensor: str) -> str:
    """Quantity of a sensor name: ``quantity_of("imu1") == "imu"``.

    Raises
    ------
    KeyError
        When the name belongs to no quantity of :data:`QUANTITIES`.
    """
    quantity = sensor.rstrip("0123456789")
    if quantity not in QUANTITIES:
        raise KeyError(f"no quantity is called {sensor!r}")
    return quantity


def empty_rows(sensor: str, size: int = 0) -> Rows:
    """Zeroed rows of the sensor's dtype, shape (size,)."""
    return np.zeros(size, dtype=QUANTITIES[quantity_of(sensor)])


@dataclass(slots=True)
class Batch:
    """Rows per sensor in arrival order, and what was rejected while they were read.

    Not to be changed once made; that it is not frozen saves a live link a sixth of the time that it
    takes to decode a message.

    Attributes
    ----------
    rows
        Sensor name -> structured array of its dtype, ``seq`` strictly increasing.
    rejected
        (sensor or ``"frame"``, reason) -> count.
    boots
        Vehicle times at which the vehicle began anew [us]: it was switched off, or rebooted. Rows
        of the new epoch have a later time, all before an earlier one.
    words : (n,) structured
        What others said, of dtype :data:`WORD`, as logs hold it, our own output included: for who
        compares it with a verdict; it is no row of a sensor.
    """

    rows: Mapping[str, Rows] = field(default_factory=dict)
    rejected: Counter[tuple[str, Rejection]] = field(default_factory=Counter)
    boots: tuple[int, ...] = ()
    words: Rows = field(default_factory=lambda: NO_WORDS)

    def __len__(self) -> int:
        return sum(len(r) for r in self.rows.values())

    @staticmethod
    def concatenate(batches: Iterable[Batch]) -> Batch:
        """One batch of several consecutive ones."""
        parts: dict[str, list[Rows]] = {}
        rejected: Counter[tuple[str, Rejection]] = Counter()
        boots: list[int] = []
        words: list[Rows] = [NO_WORDS]
        for batch in batches:
            boots += batch.boots
            words.append(batch.words)
            for sensor, rows in batch.rows.items():
                parts.setdefault(sensor, []).append(rows)
            rejected.update(batch.rejected)
        joined = {s: np.concatenate(p) for s, p in parts.items()}
        return Batch(joined, rejected, tuple(boots), np.concatenate(words))

    def split(self, seqs: Iterable[int]) -> list[Batch]:
        """Consecutive batches cut before each arrival number of ``seqs`` (ascending)."""
        edges = [np.iinfo(np.int64).min, *seqs, np.iinfo(np.int64).max]
        begun = [(self._first_seq(boot), boot) for boot in self.boots]
        out = []
        for lo, hi in itertools.pairwise(edges):
            rows = {s: r[(r["seq"] >= lo) & (r["seq"] < hi)] for s, r in self.rows.items()}
            boots = tuple(boot for seq, boot in begun if lo <= seq < hi)
            out.append(Batch({s: r for s, r in rows.items() if len(r)}, boots=boots))
        return out

    def _first_seq(self, t_us: int) -> int:
        """Arrival number of the first row from this time on, 0 if there is none."""
        later = (r["seq"][r["t_us"] >= t_us] for r in self.rows.values())
        return min((int(seq.min()) for seq in later if len(seq)), default=0)
