"""Which sensors an aircraft carries, what is broken in them, and by how much.

A :class:`Configuration` takes instruments out of a flight and says where the attitude comes from;
its :class:`Target` are the channels that are broken, one at a time, always of the first instrument.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from links.samples import Batch, quantity_of
from links.vocabulary import GYRO_ACC_AXES
from monitor.settings import Settings

__all__ = ["LADDERS", "Configuration", "Ladder", "Shape", "Target", "fitting", "pair_of"]


class Shape(StrEnum):
    """Course of the fault."""

    STEP = "step"
    RAMP = "ramp"


@dataclass(frozen=True, slots=True)
class Ladder:
    """Sizes that are tried of one quantity, in the unit that people speak in.

    Attributes
    ----------
    unit
        Of a step; a ramp is per minute.
    steps, ramps
        Ascending.
    """

    unit: str
    steps: tuple[float, ...]
    ramps: tuple[float, ...]

    def of(self, shape: Shape) -> tuple[float, ...]:
        """Sizes of steps, or of ramps."""
        return self.steps if shape is Shape.STEP else self.ramps

    def unit_of(self, shape: Shape) -> str:
        """Unit of a step, or of a ramp."""
        return self.unit if shape is Shape.STEP else f"{self.unit} a minute"


_FINE: Final = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
_COARSE: Final = (1.0, 2.0, 5.0)


def _rungs(least: float, most: float, digits: tuple[float, ...]) -> tuple[float, ...]:
    """Sizes with these leading digits between two."""
    sizes = [round(digit * 10.0**k, 6) for k in range(-3, 5) for digit in digits]
    return tuple(s for s in sizes if least <= s <= most)


def _ladder(unit: str, steps: tuple[float, float], ramps: tuple[float, float]) -> Ladder:
    """Steps a factor of 1.5 apart; ramps, found later and so dearer to try, one of 2."""
    return Ladder(unit, _rungs(*steps, _FINE), _rungs(*ramps, _COARSE))


LADDERS: Final = {
    "acc": _ladder("m/s^2", (0.1, 10.0), (0.5, 50.0)),
    "gyro": _ladder("deg/s", (0.2, 30.0), (1.0, 200.0)),
    "airspeed": _ladder("% of airspeed", (2.0, 70.0), (5.0, 500.0)),
    "aoa": _ladder("deg", (0.5, 20.0), (2.0, 100.0)),
}
"""Quantity -> sizes. A pitot that reads 70 % low or high is gross; so are 10 m/s^2 and 30 deg/s."""

PAIRS: Final = {"acc_x": "gyro_y", "gyro_y": "acc_x", "acc_y": "gyro_x", "gyro_x": "acc_y"}
"""Axes that cannot be told apart by an attitude that shares the fault (algorithms of the deployed
IMU filter: the attitude's tilt turns gravity into a specific force)."""


def pair_of(sensor: str) -> str | None:
    """The axis that is confused with this one: ``pair_of("imu0.acc_x") == "imu0.gyro_y"``."""
    base, _, axis = sensor.partition(".")
    return f"{base}.{PAIRS[axis]}" if axis in PAIRS else None


@dataclass(frozen=True, slots=True)
class Target:
    """A channel that is broken."""

    sensor: str

    @property
    def quantity(self) -> str:
        """Key of :data:`LADDERS`."""
        base, _, axis = self.sensor.partition(".")
        return axis.split("_")[0] if axis else quantity_of(base)

    @property
    def ladder(self) -> Ladder:
        """Sizes that are tried."""
        return LADDERS[self.quantity]


_AXES: Final = tuple(Target(f"imu0.{axis}") for axis in GYRO_ACC_AXES)
_QUICK_AXES: Final = ("imu0.acc_x", "imu0.acc_z", "imu0.gyro_x", "imu0.gyro_z")


@dataclass(frozen=True, slots=True)
class Configuration:
    """Sensors that an aircraft carries.

    Attributes
    ----------
    name
        As the table calls it.
    targets
        What is broken, one at a time.
    pitots, imus, vanes
        How many are left in the flight; None leaves all.
    attitude_follows
        Whether the autopilot's attitude is computed from the IMU that is broken.
    attitude_independent
        What the IMU watch is told of the attitude; None leaves the profile's word.
    pair_counts
        Whether naming the axis that cannot be told apart counts as found.
    """

    name: str
    targets: tuple[Target, ...]
    pitots: int | None = None
    imus: int | None = None
    vanes: int | None = None
    attitude_follows: bool = False
    attitude_independent: bool | None = None
    pair_counts: bool = False

    @property
    def changed(self) -> frozenset[str]:
        """Quantities whose rows a fault changes."""
        own = {quantity_of(target.sensor.partition(".")[0]) for target in self.targets}
        return frozenset(own | ({"attitude"} if self.attitude_follows else set()))

    def thinned(self, batch: Batch) -> Batch:
        """The rows of the instruments that are left."""
        left = {"airspeed": self.pitots, "imu": self.imus, "aoa": self.vanes}

        def stays(sensor: str) -> bool:
            count = left.get(quantity_of(sensor))
            return count is None or int(sensor[-1]) < count

        kept = {s: rows for s, rows in batch.rows.items() if stays(s)}
        return Batch(kept, batch.rejected, batch.boots)

    def settings(self, base: Settings) -> Settings:
        """Settings of an aircraft with these sensors."""
        if self.attitude_independent is None:
            return base
        imu = base.imu.model_copy(update={"attitude_independent": self.attitude_independent})
        return base.model_copy(update={"imu": imu})


_PITOT, _VANE = Target("airspeed0"), Target("aoa0")
ONE_PITOT: Final = Configuration("one pitot", (_PITOT,), pitots=1, vanes=0)
TWO_PITOTS: Final = Configuration("two pitots", (_PITOT,), pitots=2, vanes=0)
THREE_PITOTS: Final = Configuration("three pitots, three vanes", (_PITOT, _VANE), 3, vanes=3)
ONE_IMU_FOLLOWED: Final = Configuration(
    "one IMU, the attitude follows it",
    _AXES,
    imus=1,
    attitude_follows=True,
    attitude_independent=False,
    pair_counts=True,
)
ONE_IMU: Final = Configuration(
    "one IMU, attitude of its own", _AXES, imus=1, attitude_independent=True
)
TWO_IMUS_FOLLOWED: Final = Configuration(
    "two IMUs, the attitude follows the broken one",
    _AXES,
    imus=2,
    attitude_follows=True,
    attitude_independent=False,
)
TWO_IMUS: Final = Configuration(
    "two IMUs, attitude of its own", _AXES, imus=2, attitude_independent=True
)


def fitting(
    pitots: int, imus: int, vanes: int, *, own_attitude: bool, quick: bool = False
) -> list[Configuration]:
    """The configurations that can be made of a flight with so many instruments.

    Parameters
    ----------
    pitots, imus, vanes
        What the flight has.
    own_attitude
        Whether this class flies with attitude references of their own (transports), so that the
        attitude never follows an IMU.
    quick
        With four of the six axes of an IMU.
    """
    found: list[Configuration] = []
    if pitots >= 3 and vanes >= 3:
        found.append(THREE_PITOTS)
    else:
        found += [ONE_PITOT] if pitots >= 1 else []
        found += [TWO_PITOTS] if pitots >= 2 else []
    if imus >= 1:
        found += [ONE_IMU] if own_attitude else [ONE_IMU_FOLLOWED, ONE_IMU]
    if imus >= 2:
        found.append(TWO_IMUS if own_attitude else TWO_IMUS_FOLLOWED)
    return [_quick(c) for c in found] if quick else found


def _quick(configuration: Configuration) -> Configuration:
    from dataclasses import replace

    kept = tuple(t for t in configuration.targets if "." not in t.sensor or t.sensor in _QUICK_AXES)
    return replace(configuration, targets=kept)
