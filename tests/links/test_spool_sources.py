"""Engine-speed channels taken by name: every part, its scale, and the refusal of others."""

from __future__ import annotations

import numpy as np
import pytest

from links.mavlink import Decoder, encode
from links.mavlink.options import DecoderOptions
from links.samples import Batch
from links.spool_sources import spool_source

HEARTBEAT = {
    "type": 1, "autopilot": 3, "base_mode": 128, "custom_mode": 0, "system_status": 4,
    "mavlink_version": 3,
}  # fmt: skip
EFI = dict.fromkeys(
    (
        "health", "ecu_index", "rpm", "fuel_consumed", "fuel_flow", "engine_load",
        "throttle_position", "spark_dwell_time", "barometric_pressure", "intake_manifold_pressure",
        "intake_manifold_temperature", "cylinder_head_temperature", "ignition_timing",
        "injection_time", "exhaust_gas_temperature", "throttle_out", "pt_compensation",
    ),
    0,
)  # fmt: skip
ESC = {
    "temperature": [0] * 4, "voltage": [0] * 4, "current": [0] * 4, "totalcurrent": [0] * 4,
    "rpm": [4100, 4200, 4300, 4400], "count": [0] * 4,
}  # fmt: skip
FRAMES = (
    ("HEARTBEAT", HEARTBEAT),
    ("SYSTEM_TIME", {"time_unix_usec": 0, "time_boot_ms": 5000}),
    ("RPM", {"rpm1": 5000.0, "rpm2": 5100.0}),
    ("RAW_RPM", {"index": 1, "frequency": 5200.0}),
    ("EFI_STATUS", EFI | {"rpm": 5300.0}),
    ("ESC_TELEMETRY_5_TO_8", ESC),
    ("NAMED_VALUE_FLOAT", {"time_boot_ms": 5000, "name": "N1", "value": 80.0}),
)


def speeds(**spools: tuple[str, float]) -> dict[str, float]:
    decoder = Decoder(DecoderOptions(spools=spools))
    data = b"".join(encode(name, **fields) for name, fields in FRAMES)
    rows = Batch.concatenate([decoder.feed(data)]).rows
    return {s: float(r["speed_rpm"][-1]) for s, r in rows.items() if s.startswith("spool")}


def test_each_part_of_each_message_becomes_the_channel_it_is_named_for():
    assert speeds(
        spool0=("RPM.rpm2", 1.0),
        spool1=("RAW_RPM.1", 1.0),
        spool2=("EFI_STATUS.rpm", 1.0),
        spool3=("ESC_TELEMETRY.7", 0.5),
        spool4=("NAMED_VALUE_FLOAT.N1", 110.0),
    ) == {"spool0": 5100.0, "spool1": 5200.0, "spool2": 5300.0, "spool3": 2150.0, "spool4": 8800.0}


def test_what_is_not_named_is_not_used_once_something_is():
    assert speeds(spool0=("RAW_RPM.1", 1.0)) == {"spool0": 5200.0}
    assert speeds()["spool0"] == 5000.0


@pytest.mark.parametrize("part", ["RPM", "RPM.rpm3", "RAW_RPM.16", "ESC_TELEMETRY.0", "N1", ""])
def test_an_unknown_part_is_refused_with_what_there_is(part):
    with pytest.raises(ValueError, match="there are RPM"):
        spool_source("spool0", part)


def test_of_the_airspeed_that_the_autopilot_misses_only_the_sign_is_kept():
    decoder = Decoder()
    fields = dict.fromkeys(
        ("nav_roll", "nav_pitch", "nav_bearing", "target_bearing", "wp_dist", "xtrack_error"), 0
    )
    data = b"".join(encode(name, **f) for name, f in FRAMES[:2])
    for error in (-230.0, 0.0, 1.5):
        data += encode("NAV_CONTROLLER_OUTPUT", **fields, alt_error=12.5, aspd_error=error)
    demand = Batch.concatenate([decoder.feed(data)]).rows["demand"]
    np.testing.assert_array_equal(demand["airspeed_error_sign"], [-1.0, 0.0, 1.0])
    np.testing.assert_array_equal(demand["height_error_m"], 12.5)
