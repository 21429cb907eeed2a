"""Settings of the streams: latency, ordering horizon, time-outs."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["StreamSettings"]


class StreamSettings(Section):
    """How rows are put in order and when a stream counts as stopped."""

    horizon_s: float = Field(
        0.4,
        gt=0,
        le=5,
        description="Rows are used this long behind the newest, in order of validity time. Longer "
        "than the GPS latency plus the jitter between messages.",
    )
    gps_latency_s: float = Field(
        0.07,
        ge=0,
        le=1,
        description="Age of a GPS velocity at the time that its message is stamped with "
        "(GPS_RAW_INT.time_usec). The calm recorded flight's innovations are least at 0.07 s and "
        "ten times as large at 0.18 s; the algorithm note gives 0.05 to 0.08 s.",
    )
    imu_timeout_s: float = Field(1.0, gt=0, description="Silence after which an IMU is stale.")
    attitude_timeout_s: float = Field(
        3.0, gt=0, description="Silence after which the attitude is stale."
    )
    gps_timeout_s: float = Field(3.0, gt=0, description="Silence after which a GPS is stale.")
    airspeed_timeout_s: float = Field(
        3.0, gt=0, description="Silence after which a pitot is stale."
    )
    aoa_timeout_s: float = Field(3.0, gt=0, description="Silence after which a vane is stale.")
    spool_timeout_s: float = Field(
        5.0, gt=0, description="Silence after which an engine-speed channel is stale."
    )
    pending_rows: int = Field(
        200_000,
        gt=0,
        description="Rows per sensor that may wait for the watermark; more is dropped.",
    )
