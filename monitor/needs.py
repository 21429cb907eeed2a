"""The table: which streams the estimators need, how often, why, and who carries them.

One :class:`Need` per sensor stream. ``wanted_hz`` is asked for when less comes; below ``least_hz``
the monitor is noticeably worse, and says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from links.catalog import AUTOPILOT_PX4

__all__ = ["NEEDS", "DataStream", "Need"]


class DataStream:
    """MAV_DATA_STREAM: groups of messages, all that an autopilot without intervals knows."""

    RAW_SENSORS = 1
    EXTENDED_STATUS = 2
    RC_CHANNELS = 3
    POSITION = 6
    EXTRA1 = 10
    EXTRA3 = 12


@dataclass(frozen=True, slots=True)
class Need:
    """A stream that the estimators live on.

    Attributes
    ----------
    stream
        Sensor stream as the pipeline names it.
    message
        MAVLink message that is asked for.
    wanted_hz, least_hz
        Rate that is asked for; rate below which something is lost [1/s].
    loss
        What is lost below ``least_hz``: ends the sentence that tells it.
    group
        Data stream of ArduPilot that has this message, for one that knows no intervals.
    px4
        PX4's message where it is another one.
    fitted
        Every aircraft has this stream; of others only those that came at all are told missing.
    others
        Messages that carry the stream as well: the one that it comes from is the one to ask for,
        but not PX4, whose message is chosen for a reason.
    """

    stream: str
    message: str
    wanted_hz: float
    least_hz: float
    loss: str
    group: int
    px4: str | None = None
    fitted: bool = True
    others: tuple[str, ...] = ()

    def carrier(self, autopilot: int, used: str | None = None) -> str:
        """The message to ask this MAV_AUTOPILOT for, where the stream comes from ``used`` now."""
        if autopilot == AUTOPILOT_PX4:
            return self.px4 or self.message
        return used if used in self.others else self.message


_IMU = "IMU faults are found later"
_IMUS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU")
_PITOT = "airspeed faults are found later"

_ROWS = (
    # PX4 takes its filter's bias estimate out of HIGHRES_IMU, so a bias fades there.
    Need("imu0", "RAW_IMU", 50, 8, _IMU, DataStream.RAW_SENSORS, px4="SCALED_IMU", others=_IMUS),
    Need("imu1", "SCALED_IMU2", 50, 8, _IMU, DataStream.RAW_SENSORS, fitted=False),
    Need("imu2", "SCALED_IMU3", 50, 8, _IMU, DataStream.RAW_SENSORS, fitted=False),
    Need(
        "attitude",
        "ATTITUDE",
        20,
        4,
        "air data and IMU are judged on a coarse attitude",
        DataStream.EXTRA1,
        px4="ATTITUDE_QUATERNION",
        others=("ATTITUDE", "ATTITUDE_QUATERNION"),
    ),
    Need(
        "gps0", "GPS_RAW_INT", 5, 0.9, "wind and IMU are learnt slower", DataStream.EXTENDED_STATUS
    ),
    Need("nav", "GLOBAL_POSITION_INT", 5, 0.9, "climb rate is missing", DataStream.POSITION),
    Need("baro0", "SCALED_PRESSURE", 10, 1.8, _PITOT, DataStream.RAW_SENSORS),
    Need("airspeed0", "SCALED_PRESSURE", 10, 1.8, _PITOT, DataStream.RAW_SENSORS, fitted=False),
    Need("airspeed1", "SCALED_PRESSURE2", 10, 1.8, _PITOT, DataStream.RAW_SENSORS, fitted=False),
    Need("airspeed2", "SCALED_PRESSURE3", 10, 1.8, _PITOT, DataStream.RAW_SENSORS, fitted=False),
    Need(
        "servo",
        "SERVO_OUTPUT_RAW",
        5,
        0.9,
        "throttle is unknown to engine and wing checks",
        DataStream.RC_CHANNELS,
    ),
    Need("spool0", "RPM", 5, 0.9, "engine faults are found later", DataStream.EXTRA3, fitted=False),
    Need(
        "sys_status",
        "SYS_STATUS",
        1,
        0.3,
        "which sensors are fitted stays unknown",
        DataStream.EXTENDED_STATUS,
    ),
    Need(
        "landed",
        "EXTENDED_SYS_STATE",
        1,
        0.3,
        "take-off and landing are told by speed alone",
        DataStream.EXTENDED_STATUS,
        fitted=False,
    ),
)

NEEDS: Mapping[str, Need] = {need.stream: need for need in _ROWS}
"""Stream -> what is needed of it, in the order in which it is asked for."""
