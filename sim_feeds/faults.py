"""What breaks: the faults of wan2018 Table II and lu2016 Table 2, and blocked or iced pitots.

A :class:`Fault` changes the readings of one channel between two times; outside them the readings
are untouched. Faults of the plumbing (:data:`PLUMBING`) act on pressures, not on readings, and
belong to :func:`plumbing`.

============  =====================================================================================
kind          reading during the fault, t counted from the onset
============  =====================================================================================
bias          x + size
drift         x + rate t, at most ``limit``
runaway       as drift; the word for a fast one
oscillation   x + size sin(2 pi t / period)
noise         x + size n, n standard normal
stuck         the last reading before the onset
jamming       size, whatever the truth
nrz           x + fraction times the reading at the onset (non-return to zero)
scale         x (1 + fraction)
icing         x (1 - rate t), at least a tenth of x: ice slowly closes the opening
dropout       no data
outage        of a satellite receiver: messages go on, without a fix (see sensors.Gps)
dead          0
intermittent  in a share ``size`` of the readings anything from 0 to x: pulses that were not counted
stop          of an engine, which gives no power any more
============  =====================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from math import inf, pi
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import GYRO_ACC_AXES, Kind

__all__ = [
    "DRAWN",
    "KNOT_M_S",
    "PLUMBING",
    "Fault",
    "FaultKind",
    "Trapped",
    "apply_all",
    "draw_wan2018",
    "lu2016_table2",
    "plumbing",
]

Floats = NDArray[np.float64]
KNOT_M_S: Final = 0.514444


class FaultKind(StrEnum):
    """How a sensor breaks; finer than the :class:`~links.vocabulary.Kind` that a verdict names."""

    BIAS = "bias"
    DRIFT = "drift"
    RUNAWAY = "runaway"
    OSCILLATION = "oscillation"
    NOISE = "noise"
    STUCK = "stuck"
    JAMMING = "jamming"
    NRZ = "nrz"
    SCALE = "scale"
    ICING = "icing"
    DROPOUT = "dropout"
    OUTAGE = "outage"
    DEAD = "dead"
    INTERMITTENT = "intermittent"
    STOP = "stop"
    PITOT_BLOCKED = "pitot-blocked"
    PITOT_DRAINING = "pitot-draining"
    STATIC_BLOCKED = "static-blocked"

    @property
    def seen_as(self) -> Kind:
        """The word of the verdict vocabulary that fits best."""
        return _SEEN_AS.get(self) or Kind(self.value)


_SEEN_AS: Final = {
    FaultKind.JAMMING: Kind.STUCK,
    FaultKind.OUTAGE: Kind.DROPOUT,
    FaultKind.NRZ: Kind.BIAS,
    FaultKind.ICING: Kind.SCALE,
    FaultKind.DEAD: Kind.STUCK,
    FaultKind.INTERMITTENT: Kind.NOISE,
    FaultKind.STOP: Kind.UNKNOWN,
    FaultKind.PITOT_BLOCKED: Kind.STUCK,
    FaultKind.PITOT_DRAINING: Kind.RUNAWAY,
    FaultKind.STATIC_BLOCKED: Kind.DRIFT,
}

PLUMBING: Final = frozenset(
    {FaultKind.PITOT_BLOCKED, FaultKind.PITOT_DRAINING, FaultKind.STATIC_BLOCKED}
)
"""Faults of the tubes: they act on pressures, see :func:`plumbing`."""

DRAWN: Final = frozenset({FaultKind.NOISE, FaultKind.INTERMITTENT})
"""Faults that take a standard normal number per reading."""

ICED_SHARE: Final = 0.1
"""What a fully iced opening lets through."""


@dataclass(frozen=True, slots=True)
class Trapped:
    """Pressures at the onset of a fault of the tubes: behind the ports, and static outside."""

    total_pa: float
    static_pa: float
    free_pa: float


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of one channel.

    Attributes
    ----------
    sensor
        ``imu0.acc_x``, ``airspeed1``, ``aoa2``, ``baro0``, ``gps0`` ...
    kind
        See the table above.
    start_s, end_s
        Onset and end, in the time of the samples; without an end it stays.
    size
        In the channel's SI unit; a fraction for nrz, scale and intermittent.
    rate
        Per second: SI unit for drift and runaway, fraction for icing.
    limit
        Largest size that a drift or runaway grows to.
    period_s
        Of an oscillation.
    drain_s
        Time constant with which a blocked pitot empties through its drain hole.
    """

    sensor: str
    kind: FaultKind
    start_s: float
    end_s: float | None = None
    size: float = 0.0
    rate: float = 0.0
    limit: float = inf
    period_s: float = 1.0
    drain_s: float = 1.5

    def active(self, t_s: Floats) -> NDArray[np.bool_]:
        """Where the fault acts: start <= t < end."""
        end = inf if self.end_s is None else self.end_s
        return np.asarray((t_s >= self.start_s) & (t_s < end))

    def apply(self, t_s: Floats, x: Floats, rng: np.random.Generator) -> Floats:
        """Readings of the broken channel; a dropout reads NaN.

        Parameters
        ----------
        t_s, x : (n,) float64
            Ascending times and healthy readings.
        rng
            For faults that are :data:`DRAWN`; one draw per sample, whatever the times.
        """
        noise = rng.standard_normal(len(x)) if self.kind in DRAWN else None
        return self.disturb(t_s, x, self._before(t_s, x), noise)

    def disturb(
        self, t_s: Floats, x: Floats, held: Floats | float, noise: Floats | None = None
    ) -> Floats:
        """As :meth:`apply`, reading by reading, for who sees the readings piece by piece.

        Parameters
        ----------
        t_s, x : (n,) float64
            Times and healthy readings.
        held : (n,) float64 or float
            Last reading before the onset.
        noise : (n,) float64
            Standard normal, for faults that are :data:`DRAWN`.
        """
        on = self.active(t_s)
        age = np.where(on, t_s - self.start_s, 0.0)
        match self.kind:
            case FaultKind.BIAS:
                broken = x + self.size
            case FaultKind.DRIFT | FaultKind.RUNAWAY:
                broken = x + np.clip(self.rate * age, -self.limit, self.limit)
            case FaultKind.OSCILLATION:
                broken = x + self.size * np.sin(2.0 * pi * age / self.period_s)
            case FaultKind.NOISE:
                broken = x if noise is None else x + self.size * noise
            case FaultKind.STUCK:
                broken = np.broadcast_to(np.float64(held), x.shape)
            case FaultKind.JAMMING:
                broken = np.full_like(x, self.size)
            case FaultKind.NRZ:
                broken = x + self.size * held
            case FaultKind.SCALE:
                broken = x * (1.0 + self.size)
            case FaultKind.ICING:
                broken = x * np.maximum(1.0 - self.rate * age, ICED_SHARE)
            case FaultKind.DROPOUT:
                broken = np.full_like(x, np.nan)
            case FaultKind.DEAD:
                broken = np.zeros_like(x)
            case FaultKind.INTERMITTENT:
                broken = x if noise is None else x * _counted(noise, self.size)
            case _:
                return x
        return np.where(on, broken, x)

    def port(
        self, t_s: Floats, total_pa: Floats, static_pa: Floats, free_pa: Floats, trapped: Trapped
    ) -> tuple[Floats, Floats]:
        """Total and static pressure behind a damaged tube, see :func:`plumbing`.

        Parameters
        ----------
        t_s, total_pa, static_pa : (n,) float64
            Times, and the pressures as other faults left them.
        free_pa : (n,) float64
            Static pressure outside, which a drain hole leads to.
        trapped
            What stood in the tubes at the onset.
        """
        on = self.active(t_s)
        match self.kind:
            case FaultKind.STATIC_BLOCKED:
                return total_pa, np.where(on, trapped.static_pa, static_pa)
            case FaultKind.PITOT_BLOCKED:
                return np.where(on, trapped.total_pa, total_pa), static_pa
            case FaultKind.PITOT_DRAINING:
                left = np.exp(-np.where(on, t_s - self.start_s, 0.0) / self.drain_s)
                draining = free_pa + left * (trapped.total_pa - trapped.free_pa)
                return np.where(on, draining, total_pa), static_pa
            case _:
                return total_pa, static_pa

    def _before(self, t_s: Floats, x: Floats) -> float:
        """Last reading before the onset."""
        return float(x[max(int(np.searchsorted(t_s, self.start_s)) - 1, 0)]) if len(x) else 0.0


def _counted(noise: Floats, share: float) -> Floats:
    """Share of the pulses that a reading counted: 1, or in ``share`` of the readings uniform."""
    limit = NormalDist().inv_cdf(share)
    lost = noise < limit
    out = np.ones_like(noise)
    out[lost] = [NormalDist().cdf(n) / share for n in noise[lost].tolist()]
    return out


def apply_all(faults: list[Fault], t_s: Floats, x: Floats, rng: np.random.Generator) -> Floats:
    """Readings after all faults of one channel, in the order of the list.

    Each fault draws from its own child of ``rng``: adding a fault leaves the noise of others alone.
    """
    for fault, child in zip(faults, rng.spawn(len(faults)), strict=True):
        x = fault.apply(t_s, x, child)
    return x


def plumbing(
    faults: list[Fault], t_s: Floats, impact_pa: Floats, static_pa: Floats
) -> tuple[Floats, Floats]:
    """Differential and static pressure that reach the sensors through damaged tubes.

    A total port blocked together with its drain hole traps the total pressure of the onset: the
    difference then follows the static pressure, and the airspeed reads like an altimeter. Blocked
    with the drain hole open, the trapped pressure leaks to static and the airspeed falls to zero. A
    blocked static port traps the static pressure: the airspeed reads low above the height of the
    onset and high below, and the altimeter stands still.

    Parameters
    ----------
    faults
        Those of one pitot-static system; others than :data:`PLUMBING` are ignored.
    t_s, impact_pa, static_pa : (n,) float64
        Times, true impact pressure, true static pressure.

    Returns
    -------
    difference_pa, static_pa : (n,) float64
    """
    total, static = static_pa + impact_pa, static_pa.copy()
    for fault in faults:
        on = fault.active(t_s)
        if fault.kind not in PLUMBING or not on.any():
            continue
        k = int(np.argmax(on))
        trapped = Trapped(float(total[k]), float(static[k]), float(static_pa[k]))
        total, static = fault.port(t_s, total, static, static_pa, trapped)
    return total - static, static


def lu2016_table2(imu: str = "imu0", start_s: float = 10.0, end_s: float = 30.0) -> list[Fault]:
    """The six simultaneous IMU faults of lu2016 Table 2.

    Its 4 sin(0.5 pi t) from t = 10 s on is -4 sin(0.5 pi (t - 10)).
    """
    degree = pi / 180.0
    x, y, z, p, q, r = (f"{imu}.{axis}" for axis in GYRO_ACC_AXES)
    shapes = [
        Fault(x, FaultKind.BIAS, start_s, size=3.0),
        Fault(y, FaultKind.DRIFT, start_s, rate=0.1),
        Fault(z, FaultKind.OSCILLATION, start_s, size=-4.0, period_s=4.0),
        Fault(p, FaultKind.BIAS, start_s, size=1.5 * degree),
        Fault(q, FaultKind.OSCILLATION, start_s, size=degree, period_s=4.0),
        Fault(r, FaultKind.BIAS, start_s, size=3.0 * degree),
    ]
    return [replace(f, end_s=end_s) for f in shapes]


def draw_wan2018(
    rng: np.random.Generator,
    sensor: str,
    start_s: float,
    end_s: float | None = None,
    kind: FaultKind | None = None,
) -> Fault:
    """A random fault from the ranges of wan2018 Table II, for ``aoaN`` or ``airspeedN``.

    Sizes are log-uniform over the printed ranges; the sign is random, except of a jamming airspeed.
    """
    vane = sensor.startswith("aoa")
    unit = pi / 180.0 if vane else KNOT_M_S
    choices = ("oscillation", "jamming", "bias", "runaway", "nrz", "noise")
    kind = kind or FaultKind(choices[rng.integers(len(choices))])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    sign = 1.0 if rng.random() < 0.5 else -1.0
    size = between(0.5, 25.0) * unit if vane else between(10.0, 200.0) * unit
    fault = Fault(sensor, kind, start_s, end_s, size=sign * size)
    match kind:
        case FaultKind.OSCILLATION:
            return replace(fault, period_s=1.0 / (rng.uniform(0.5, 1.0 if vane else 4.0)))
        case FaultKind.JAMMING:
            return fault if vane else replace(fault, size=size)
        case FaultKind.RUNAWAY:
            rate = between(0.2, 25.0) if vane else between(0.5, 50.0)
            return replace(fault, size=0.0, rate=sign * rate * unit)
        case FaultKind.NRZ:
            return replace(fault, size=sign * 0.1)
        case FaultKind.NOISE:
            return replace(fault, size=(rng.uniform(1, 2) if vane else rng.uniform(10, 20)) * unit)
        case _:
            return fault
