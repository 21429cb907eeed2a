"""What is read from a link, whatever carries it."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from links import catalog_dataflash, catalog_ulog, dataflash_columns
from links.catalog import MAX_INSTANCES, RANKING, SOURCES
from links.endpoints import LinkOptions, check_spec
from links.mavlink import DecoderOptions
from links.spool_sources import spool_source
from monitor.settings.base import Section

__all__ = ["LinkSettings", "SourceSettings", "SpoolSource"]

_NAMED = "NAMED_VALUE_FLOAT"
_SPOOLS = tuple(f"spool{i}" for i in range(MAX_INSTANCES["spool"]))
_FORMATS = (SOURCES, catalog_dataflash.SOURCES, catalog_ulog.SOURCES)
_NAMES = {_NAMED, dataflash_columns.NAMED, catalog_ulog.NAMED}
_KNOWN = {q: {s.key for f in _FORMATS for s in f if s.quantity == q} | _NAMES for q in RANKING}


def _order(quantity: str) -> tuple[str, ...]:
    return Field(
        RANKING[quantity],
        description=f"Messages that {quantity} is taken from, the first usable one wins; one that "
        "is not listed is not used. Messages of DataFlash and topics of ULog may be listed too: "
        "each format goes by its own, and by its default where none of its own is listed.",
    )


class SourceSettings(Section):
    """Which messages speak for a sensor, best first."""

    imu: tuple[str, ...] = Field(
        (),
        description="Messages that imu is taken from, as of the others. Empty: HIGHRES_IMU, "
        "RAW_IMU, SCALED_IMU, and for PX4 the reverse, since PX4 takes its filter's bias estimate "
        "out of HIGHRES_IMU.",
    )
    attitude: tuple[str, ...] = _order("attitude")
    gps: tuple[str, ...] = _order("gps")
    airspeed: tuple[str, ...] = _order("airspeed")
    baro: tuple[str, ...] = _order("baro")
    aoa: tuple[str, ...] = _order("aoa")
    spool: tuple[str, ...] = _order("spool")

    @model_validator(mode="after")
    def _known(self) -> Self:
        for quantity in type(self).model_fields:
            strange = set(getattr(self, quantity)) - _KNOWN[quantity]
            if strange:
                known = ", ".join(sorted(_KNOWN[quantity]))
                raise ValueError(f"{quantity} is not carried by {min(strange)}; choose of {known}")
        return self


class SpoolSource(Section):
    """Which part of which message is one engine-speed channel."""

    source: str = Field(
        description="RPM.rpm1, RPM.rpm2, RAW_RPM.0 ... RAW_RPM.15, EFI_STATUS.rpm, "
        "ESC_TELEMETRY.1 ... ESC_TELEMETRY.16, or NAMED_VALUE_FLOAT.NAME; in a .BIN or .ulg the "
        "messages and topics that carry the same.",
    )
    rpm_per_unit: float = Field(
        1.0,
        gt=0,
        description="What one unit of it is [rpm]: of percent, a hundredth of full scale.",
    )


class LinkSettings(Section):
    """The links, the vehicle, our own place in its network, and how the loop reads."""

    inputs: tuple[str, ...] = Field(
        ("udpin:0.0.0.0:14550",),
        min_length=1,
        description="Links that the vehicle's MAVLink comes from, unless --in names others: "
        "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, a serial device as "
        "/dev/serial/by-id/NAME[:BAUD] (also a pattern), or FILE.tlog.",
    )
    outputs: tuple[str, ...] = Field(
        (),
        description="Links that are published to beside the inputs, unless --out names others; "
        "FILE.tlog makes a new log.",
    )
    retry_first_s: float = Field(
        0.5,
        ge=0.05,
        le=60,
        description="Wait after a link was lost or could not be opened; it doubles with each "
        "failure, give or take a quarter.",
    )
    retry_longest_s: float = Field(
        10.0, ge=0.05, le=600, description="Longest of these waits between attempts."
    )
    watchdog_s: float = Field(
        10.0,
        ge=0,
        le=3600,
        description="A TCP connection of ours or a serial port that brings nothing for this time "
        "is opened anew, and the name of a UDP peer asked for again; 0 never. A link that has "
        "never brought anything is an output and left alone.",
    )
    peer_timeout_s: float = Field(
        10.0,
        gt=0,
        le=3600,
        description="Silence after which a peer of a listening UDP link is no longer answered; the "
        "one heard last is answered until another one is believed.",
    )
    send_queue_kib: float = Field(
        64.0,
        ge=1,
        le=16384,
        description="What may wait for a slow TCP peer or serial port; the oldest messages are "
        "dropped for newer ones, of a serial port already those that need more than a second.",
    )
    dialect: str = Field(
        "ardupilotmega",
        pattern=r"^[A-Za-z0-9_]+$",
        description="MAVLink dialect by pymavlink's name: ardupilotmega, all, common ...",
    )
    system_id: int = Field(
        0,
        ge=0,
        le=255,
        description="MAVLink system id of the vehicle; 0 takes the first autopilot that is heard.",
    )
    autopilot_component_id: int = Field(
        1, ge=1, le=255, description="MAVLink component id that sensors are taken from."
    )
    component_id: int = Field(
        191,
        ge=1,
        le=255,
        description="Our own MAVLink component id: what carries it is ours, never an input.",
    )
    components: dict[str, tuple[int, ...]] = Field(
        default_factory=dict,
        description="MAVLink message -> component ids that it is taken from, where that is not "
        "the autopilot alone.",
    )
    sources: SourceSettings = SourceSettings()
    spools: dict[str, SpoolSource] = Field(
        default_factory=dict,
        description="Engine-speed channel (spool0 ...) -> where it comes from. Empty: RPM, "
        "RAW_RPM, EFI_STATUS, ESC_TELEMETRY or NAMED_VALUE_FLOAT, the first that speaks; of "
        "several that measure one shaft each can be a channel of its own only by its name here.",
    )
    source_timeout_s: float = Field(
        2.0,
        gt=0,
        le=60,
        description="Silence of a message after which the next one in rank speaks for the sensor.",
    )
    airspeed_ratio: float = Field(
        2.0,
        gt=0,
        le=10,
        description="ARSPD_RATIO used until the vehicle's parameter is heard: CAS = sqrt(ratio * "
        "differential pressure in pascal). 2.0 is ArduPilot's default.",
    )
    silent_after_s: float = Field(
        3.0,
        gt=0,
        le=60,
        description="Time without a sample of the vehicle (host clock) after which the link is "
        "silent: the heartbeat says EMERGENCY.",
    )
    coalesce_ms: float = Field(
        20.0,
        ge=0,
        le=200,
        description="Datagrams are gathered for this time before they are worked on: less waking "
        "up against more latency.",
    )

    @model_validator(mode="after")
    def _links(self) -> Self:
        for spec in (*self.inputs, *self.outputs):
            check_spec(spec)
        if self.retry_longest_s < self.retry_first_s:
            raise ValueError("retry_longest_s is shorter than retry_first_s")
        return self

    @model_validator(mode="after")
    def _spools(self) -> Self:
        for sensor, spool in self.spools.items():
            if sensor not in _SPOOLS:
                raise ValueError(f"{sensor} is no engine-speed channel; they are spool0 to spool15")
            spool_source(sensor, spool.source)
        return self

    def link_options(self) -> LinkOptions:
        """The part that links are kept open by; what may mend by itself is waited for."""
        return LinkOptions(
            patient=True,
            retry_first_s=self.retry_first_s,
            retry_longest_s=self.retry_longest_s,
            watchdog_s=self.watchdog_s,
            peer_timeout_s=self.peer_timeout_s,
            queue_bytes=round(self.send_queue_kib * 1024),
        )

    def decoder_options(self) -> DecoderOptions:
        """The part that the decoder takes."""
        sources = self.sources.model_dump()
        return DecoderOptions(
            dialect=self.dialect,
            system_id=self.system_id or None,
            autopilot_component=self.autopilot_component_id,
            own_component=self.component_id,
            components={name: frozenset(ids) for name, ids in self.components.items()},
            ranking={q: k for q, k in sources.items() if k and k != RANKING[q]},
            spools={s: (p.source, p.rpm_per_unit) for s, p in self.spools.items()},
            airspeed_ratio=self.airspeed_ratio,
            source_timeout_us=round(self.source_timeout_s * 1e6),
        )
