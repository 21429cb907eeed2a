"""What the daemon sends over MAVLink, and how often."""

from typing import Literal

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["PublishSettings"]


class PublishSettings(Section):
    """The outgoing messages. HEARTBEAT goes out at 1 Hz whatever stands here."""

    to_input: bool = Field(
        True,
        description="Send back over the link that the vehicle's data comes in on, besides every "
        "--out (an input that is a file takes nothing).",
    )
    mask_rate_hz: float = Field(
        2.0,
        gt=0,
        le=50,
        description="Rate of the fault and monitor masks FLT_* and MON_*; a fault mask also goes "
        "out at once when it changes.",
    )
    value_rate_hz: float = Field(
        5.0,
        ge=0,
        le=50,
        description="Rate of reconstructed values (R_*, AIRSPEED, AOA_SSA, WIND_COV, IMU_FLT and "
        "the reconstructed IMU); 0 sends none.",
    )
    values_named: bool = Field(
        True,
        description="Send reconstructed air data as NAMED_VALUE_FLOAT R_CAS ... R_WD, engine "
        "speeds as R_N1 ... R_N4.",
    )
    values_standard: bool = Field(
        True,
        description="Send reconstructed air data as AIRSPEED (id 9), AOA_SSA and WIND_COV, where "
        "the dialect has them.",
    )
    imu_faults: bool = Field(
        True, description="Send reconstructed IMU faults as DEBUG_FLOAT_ARRAY IMU_FLT."
    )
    imu_reconstructed: Literal["off", "HIGHRES_IMU", "SCALED_IMU"] = Field(
        "off",
        description="Send specific force and rates freed of reconstructed faults: HIGHRES_IMU "
        "with id 9 + instance, or SCALED_IMU, SCALED_IMU2, SCALED_IMU3.",
    )
    value_age_max_s: float = Field(
        2.0,
        gt=0,
        le=60,
        description="An estimate older than this behind the vehicle's stream is not sent.",
    )
    text: bool = Field(True, description="Announce changes as STATUSTEXT.")
    text_burst: int = Field(
        4, ge=1, le=20, description="STATUSTEXT that may go out at once after a quiet time, count."
    )
    text_interval_s: float = Field(
        2.0,
        gt=0,
        le=60,
        description="Least mean time between STATUSTEXT; changes that come faster are folded into "
        "one text.",
    )
