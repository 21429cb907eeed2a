"""Sensors that an operator has muted."""

from pydantic import Field

from monitor.masks import SENSORS
from monitor.settings.base import Section

__all__ = ["MuteSettings"]


class MuteSettings(Section):
    """Sensors that nothing is said of, as masks with the bits of FLT_AIR, FLT_IMU0 ...

    A muted sensor is unmonitored, "muted by the operator", and its flag stays down. It is judged
    in silence all the same: unmuted, it is at once what it would be.
    """

    air: int = Field(
        0,
        ge=0,
        lt=1 << 24,
        description="Pitots and vanes: bits 0 to 2 airspeed0 ..., bits 8 to 10 aoa0 ...",
    )
    imu0: int = Field(
        0,
        ge=0,
        lt=1 << 24,
        description="First IMU: bits 0 to 5 acc_x, acc_y, acc_z, gyro_x, gyro_y, gyro_z; 63 is "
        "all of it.",
    )
    imu1: int = Field(0, ge=0, lt=1 << 24, description="The same of the second IMU.")
    imu2: int = Field(0, ge=0, lt=1 << 24, description="The same of the third IMU.")
    imu3: int = Field(0, ge=0, lt=1 << 24, description="The same of the fourth IMU.")
    imu4: int = Field(0, ge=0, lt=1 << 24, description="The same of the fifth IMU.")
    eng: int = Field(0, ge=0, lt=1 << 24, description="Engine-speed channels: bit i is spool i.")
    wng: int = Field(
        0,
        ge=0,
        lt=1 << 24,
        description="Wings: bits 0 to 3 wing_left.lift, wing_left.drag, wing_right.lift, "
        "wing_right.drag.",
    )

    @property
    def sensors(self) -> frozenset[str]:
        """Names of the muted sensors; bits that are no sensor's mute nothing."""
        return frozenset(
            sensor
            for mask, bits in SENSORS.items()
            for bit, sensor in bits.items()
            if getattr(self, mask.lower()) >> bit & 1
        )
