"""The table of faults in scenario and injection files: one fault, its size in a unit that fits."""

from __future__ import annotations

import re
from math import radians
from typing import Final

from pydantic import Field, model_validator

from links.vocabulary import GYRO_ACC_AXES
from sim_feeds.faults import KNOT_M_S, PLUMBING, Fault, FaultKind
from sim_feeds.section import Strict
from sim_feeds.sensors import GPS_AXES

__all__ = ["ATTITUDE_AXES", "FaultEntry"]

ATTITUDE_AXES: Final = ("roll", "pitch", "yaw")
WING_FORCES: Final = ("lift", "drag")

_UNITS: Final[dict[str, dict[str, float]]] = {
    "acc": {"m_s2": 1.0},
    "gyro": {"rad_s": 1.0, "deg_s": radians(1.0)},
    "airspeed": {"m_s": 1.0, "kt": KNOT_M_S},
    "aoa": {"rad": 1.0, "deg": radians(1.0)},
    "baro": {"pa": 1.0},
    "gps": {"m_s": 1.0},
    "attitude": {"rad": 1.0, "deg": radians(1.0)},
    "spool": {"rpm": 1.0},
    "wing": {"percent": 1.0},
    "engine": {},
}
"""Quantity of a sensor -> units in which a fault's size may be written, as factors to SI."""

_NEEDS: Final = {
    FaultKind.BIAS: "size",
    FaultKind.OSCILLATION: "size",
    FaultKind.NOISE: "size",
    FaultKind.JAMMING: "size",
    FaultKind.DRIFT: "rate",
    FaultKind.RUNAWAY: "rate",
    FaultKind.SCALE: "fraction",
    FaultKind.NRZ: "fraction",
    FaultKind.INTERMITTENT: "fraction",
    FaultKind.ICING: "fraction_per_s",
}


class FaultEntry(Strict):
    """One fault: ``size_<unit>`` or ``rate_<unit>_per_s`` in a unit that fits the sensor.

    bias, oscillation, noise and jamming need a size; drift and runaway a rate; scale and nrz a
    ``fraction``; icing a ``fraction_per_s``. An engine-speed sensor is intermittent in a
    ``fraction`` of its readings. Wings are damaged by a bias (at once) or a drift in percent: lift
    that is lost, drag that is added. An engine can only stop.
    """

    sensor: str
    kind: FaultKind
    start_s: float = Field(ge=0.0)
    end_s: float | None = Field(None, gt=0.0)
    size_m_s2: float | None = None
    size_rad_s: float | None = None
    size_deg_s: float | None = None
    size_m_s: float | None = None
    size_kt: float | None = None
    size_rad: float | None = None
    size_deg: float | None = None
    size_pa: float | None = None
    size_rpm: float | None = None
    size_percent: float | None = None
    rate_m_s2_per_s: float | None = None
    rate_rad_s_per_s: float | None = None
    rate_deg_s_per_s: float | None = None
    rate_m_s_per_s: float | None = None
    rate_kt_per_s: float | None = None
    rate_rad_per_s: float | None = None
    rate_deg_per_s: float | None = None
    rate_pa_per_s: float | None = None
    rate_rpm_per_s: float | None = None
    rate_percent_per_s: float | None = None
    limit_m_s2: float | None = Field(None, gt=0.0)
    limit_deg_s: float | None = Field(None, gt=0.0)
    limit_m_s: float | None = Field(None, gt=0.0)
    limit_kt: float | None = Field(None, gt=0.0)
    limit_deg: float | None = Field(None, gt=0.0)
    limit_rpm: float | None = Field(None, gt=0.0)
    limit_percent: float | None = Field(None, gt=0.0)
    fraction: float | None = Field(None, description="Of the reading: -0.2 reads 20 % low.")
    fraction_per_s: float | None = Field(None, gt=0.0)
    period_s: float = Field(2.0, gt=0.0)
    drain_s: float = Field(1.5, gt=0.0)

    @property
    def quantity(self) -> str:
        """Key of the units that its size may have; empty for a whole instrument."""
        base, _, axis = self.sensor.partition(".")
        if axis in GYRO_ACC_AXES and re.fullmatch(r"imu[0-4]", base):
            return axis.split("_")[0]
        if axis in GPS_AXES and re.fullmatch(r"gps[01]", base):
            return "gps"
        if axis in ATTITUDE_AXES and base == "attitude":
            return "attitude"
        if axis in WING_FORCES and re.fullmatch(r"wing_(left|right)", base):
            return "wing"
        if not axis and re.fullmatch(r"engine\d", base):
            return "engine"
        if not axis and re.fullmatch(r"(airspeed|aoa|baro)[0-2]|spool(\d|1[0-5])", base):
            return base.rstrip("0123456789")
        if not axis and re.fullmatch(r"imu[0-4]|gps[01]|attitude", base):
            return ""
        raise ValueError(
            f"{self.sensor!r} is no sensor: imu0.acc_x ... imu4.gyro_z, airspeed0..2, aoa0..2, "
            "baro0..2, gps0.vel_n, attitude.roll, spool0, wing_left.lift, engine0, or for a "
            "dropout imu0, gps0, attitude"
        )

    @model_validator(mode="after")
    def _fits(self) -> FaultEntry:
        quantity = self.quantity
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        if not quantity and self.kind not in (FaultKind.DROPOUT, FaultKind.OUTAGE):
            raise ValueError(f"{self.sensor} as a whole can only drop out; name one of its axes")
        if self.kind is FaultKind.OUTAGE and not re.fullmatch(r"gps[01]", self.sensor):
            raise ValueError("an outage is a fault of gps0 or gps1")
        if self.kind in PLUMBING and quantity != "airspeed":
            raise ValueError(f"{self.kind} is a fault of an airspeed sensor's tubes")
        if quantity == "wing" and self.kind not in (FaultKind.BIAS, FaultKind.DRIFT):
            raise ValueError("a wing is damaged by a bias or a drift, in percent")
        if (quantity == "engine") != (self.kind is FaultKind.STOP):
            raise ValueError("an engine can only stop, and only an engine does")
        if self.kind is FaultKind.STOP and self.end_s is not None:
            raise ValueError("an engine that stopped is not started again: no end_s")
        if self.kind is FaultKind.INTERMITTENT and quantity != "spool":
            raise ValueError("intermittent is a fault of an engine-speed sensor")
        if self.kind is FaultKind.INTERMITTENT and not 0.0 < (self.fraction or 0.0) < 1.0:
            raise ValueError("intermittent needs a fraction between 0 and 1")
        fitting = _UNITS.get(quantity, {})
        for key in sorted(self.model_fields_set):
            unit = re.fullmatch(r"(?:size|limit)_(\w+)|rate_(\w+)_per_s", key)
            if unit and (unit[1] or unit[2]) not in fitting:
                raise ValueError(
                    f"{key} does not fit {self.sensor}: its units are {_listed(fitting)}"
                )
        need = _NEEDS.get(self.kind)
        if need in ("fraction", "fraction_per_s") and getattr(self, need) is None:
            raise ValueError(f"{self.kind} needs {need}")
        if need in ("size", "rate") and self._in_si(need) is None:
            end = "_per_s" if need == "rate" else ""
            keys = " or ".join(f"{need}_{unit}{end}" for unit in _UNITS[quantity])
            raise ValueError(f"{self.kind} of {self.sensor} needs {keys}")
        return self

    def _in_si(self, what: str) -> float | None:
        end = "_per_s" if what == "rate" else ""
        for unit, factor in _UNITS.get(self.quantity, {}).items():
            value = getattr(self, f"{what}_{unit}{end}", None)
            if value is not None:
                return float(value) * factor
        return None

    def fault(self) -> Fault:
        """The fault model, in SI."""
        return Fault(
            sensor=self.sensor,
            kind=self.kind,
            start_s=self.start_s,
            end_s=self.end_s,
            size=self.fraction if self.fraction is not None else self._in_si("size") or 0.0,
            rate=self.fraction_per_s or self._in_si("rate") or 0.0,
            limit=self._in_si("limit") or float("inf"),
            period_s=self.period_s,
            drain_s=self.drain_s,
        )


def _listed(units: dict[str, float]) -> str:
    return ", ".join(units) or "none"
