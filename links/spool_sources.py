"""Engine-speed channels by name: which part of which message speaks for ``spool0``, ``spool1`` ...

The catalogue gives every message that carries engine speeds the numbers of its own and lets the
best one speak: RPM, an engine computer and an ESC that all tell the speed of one shaft are then one
channel. To have them as redundant channels each is given a number of its own by its name here.
"""

from __future__ import annotations

from dataclasses import replace

from links.catalog import SOURCES, Fill, Source, named_source
from links.conversions import Condition, Conversion

__all__ = ["SPOOL_PARTS", "spool_source"]

SPOOL_PARTS = (
    "RPM.rpm1, RPM.rpm2, RAW_RPM.0 ... RAW_RPM.15, EFI_STATUS.rpm, "
    "ESC_TELEMETRY.1 ... ESC_TELEMETRY.16, NAMED_VALUE_FLOAT.NAME"
)
"""What :func:`spool_source` understands."""


def spool_source(sensor: str, part: str, rpm_per_unit: float = 1.0) -> Source:
    """Source of one engine-speed channel by message and part: ``"EFI_STATUS.rpm"``.

    Parameters
    ----------
    sensor
        ``spool0`` ... ``spool15``.
    part
        One of :data:`SPOOL_PARTS`.
    rpm_per_unit
        What one unit of the message is [rpm]: of a speed in percent, a hundredth of full scale; of
        an ESC's electrical speed, one over the pairs of poles.

    Raises
    ------
    ValueError
        The part is none of those.
    """
    message, _, name = part.partition(".")
    if message == "NAMED_VALUE_FLOAT" and 0 < len(name) <= 10:
        return named_source(name, sensor, "speed_rpm", rpm_per_unit)
    known = {_part(source): source for source in SOURCES if source.quantity == "spool"}
    if message == "RAW_RPM" and name.isdecimal() and int(name) < 16:
        number, source = int(name), known["RAW_RPM."]
        return replace(
            source,
            sensor=sensor,
            instance=None,
            only=Condition("index", equals=number),
            fills=tuple(_scaled(f, rpm_per_unit) for f in source.fills),
        )
    if name and part in known:
        source = known[part]
        return replace(
            source, sensor=sensor, fills=tuple(_scaled(f, rpm_per_unit) for f in source.fills)
        )
    raise ValueError(f"{sensor}: no engine speed is called {part!r}; there are {SPOOL_PARTS}")


def _part(source: Source) -> str:
    """The name of a catalogue source's part; RAW_RPM's has its number still to come."""
    match source.key:
        case "ESC_TELEMETRY":
            return f"ESC_TELEMETRY.{int(source.sensor.removeprefix('spool')) + 1}"
        case "RAW_RPM":
            return "RAW_RPM."
        case key:
            return f"{key}.{source.fills[0].fields[0]}"


def _scaled(fill: Fill, factor: float) -> Fill:
    """The same with values so many times as large."""
    if factor == 1.0:
        return fill
    compute, invert = fill.compute, fill.invert
    if not isinstance(compute, Conversion):
        return replace(fill, scale=fill.scale * factor)
    return replace(
        fill,
        compute=replace(compute, factor=compute.factor * factor),
        invert=None if invert is None else lambda p, values: invert(p, values / factor),
    )
