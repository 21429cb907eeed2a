"""Engine-speed channels by name in logs of records: what MAVLink's part is there.

One configuration serves the live link and the log of the same flight: ``ESC_TELEMETRY.3`` is the
third ESC, whether a telemetry frame, a DataFlash record or a ULog topic tells its speed. The parts
are those of :mod:`links.spool_sources`.

=====================  =====================  =====================================
part                   DataFlash              ULog
=====================  =====================  =====================================
RPM.rpm1, RPM.rpm2     RPM of I 0, 1          rpm, instance 0, 1
RAW_RPM.k              RPM of I k             rpm, instance k
EFI_STATUS.rpm         EFI.Rpm                internal_combustion_engine_status
ESC_TELEMETRY.k        ESC of Instance k - 1  esc_status.esc[k - 1]
NAMED_VALUE_FLOAT.n    NVAL of name n         debug_key_value of key n
=====================  =====================  =====================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links import catalog_dataflash, catalog_ulog
from links.catalog import bounded
from links.conversions import Payload
from links.dataflash_columns import ESCS
from links.mavlink.options import DecoderOptions
from links.record_sources import RecordSource

__all__ = ["dataflash_spools", "ulog_spools", "with_spools"]

Parts = Mapping[str, tuple[str, float]]


@dataclass(frozen=True, slots=True)
class _Channel:
    """A channel: its message, which of several, the factor to rpm."""

    sensor: str
    message: str
    number: int
    name: str
    factor: float


def _channels(parts: Parts) -> list[_Channel]:
    out = []
    for sensor, (part, factor) in parts.items():
        message, _, name = part.partition(".")
        number = int(name) if name.isdecimal() else 0
        match message:
            case "RPM":
                message, number = "RPM", ("rpm1", "rpm2").index(name)
            case "RAW_RPM":
                message = "RPM"
            case "ESC_TELEMETRY":
                number -= 1
        out.append(_Channel(sensor, message, number, name, factor))
    return out


def dataflash_spools(options: DecoderOptions) -> list[RecordSource]:
    """Sources of the channels in a DataFlash log; empty where none was chosen by name."""
    out: list[RecordSource] = []
    for c in _channels(options.spools):
        if c.message == "NAMED_VALUE_FLOAT":
            out += catalog_dataflash.named_sources(
                {c.name: (c.sensor, "speed_rpm", c.factor)},
                options.own_component,
                options.components.get("NAMED_VALUE_FLOAT"),
            )[1:]
        elif c.message == "EFI_STATUS":
            out.append(_source("EFI", "EFI", "Rpm", c))
        elif c.message == "RPM":
            out.append(_source("RPM", "RPM", "RPM", c, "I"))
            if c.number < 2:
                out.append(_source("RPM", "RPM", f"rpm{c.number + 1}", c))
        else:
            out.append(_source("ESC", "ESC", "RPM", c, "Instance"))
            if c.number < len(ESCS):
                out.append(_source("ESC", ESCS[c.number], "RPM", c))
    return out


def ulog_spools(options: DecoderOptions) -> list[RecordSource]:
    """Sources of the channels in a ULog; empty where none was chosen by name."""
    out: list[RecordSource] = []
    for c in _channels(options.spools):
        if c.message == "NAMED_VALUE_FLOAT":
            out += catalog_ulog.named_sources({c.name: (c.sensor, "speed_rpm", c.factor)})
        elif c.message == "EFI_STATUS":
            topic = "internal_combustion_engine_status"
            out.append(_source(topic, topic, "engine_speed_rpm", c, topic_instance=0))
        elif c.message == "RPM":
            out += [
                _source("rpm", "rpm", column, c, topic_instance=c.number)
                for column in ("rpm_estimate", "indicated_frequency_rpm")
            ]
        else:
            esc = f"esc[{c.number}].esc_rpm"
            out.append(_source("esc_status", "esc_status", esc, c, topic_instance=0))
    return out


def with_spools(
    sources: Iterable[RecordSource], chosen: Iterable[RecordSource]
) -> list[RecordSource]:
    """A table's sources, its engine speeds replaced by the chosen channels where there are any."""
    chosen = list(chosen)
    return [s for s in sources if not (chosen and s.quantity == "spool")] + chosen


def _source(
    key: str,
    message: str,
    column: str,
    c: _Channel,
    instance: str | None = None,
    topic_instance: int | None = None,
) -> RecordSource:
    return RecordSource(
        key,
        message,
        c.sensor,
        (bounded("speed_rpm", (column,), c.factor),),
        only=None if instance is None else _is(instance, c.number),
        needs=() if instance is None else (instance,),
        number=topic_instance,
    )


def _is(column: str, number: int) -> Callable[[Payload], NDArray[np.bool_]]:
    return lambda p: np.asarray(p[column] == number)
