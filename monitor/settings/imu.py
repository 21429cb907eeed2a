"""Settings of the IMU watch."""

from __future__ import annotations

from pydantic import Field, PositiveFloat

from estimators.ins_bank_model import MAX_WINDOWS
from monitor.settings.base import Section

__all__ = ["ImuSettings"]


class ImuSettings(Section):
    """Noise, thresholds and times of the IMU watch."""

    attitude_independent: bool = Field(
        False,
        description="True where ATTITUDE comes from a reference with its own gyros (an airliner's "
        "AHRS); False where the autopilot computes it from the IMU under test, as ArduPilot and "
        "PX4 do: it then shares the IMU's fault and alone is no evidence.",
    )
    acc_noise_m_s2_sqrt_hz: PositiveFloat = Field(
        0.03,
        description="Least noise density of the specific force. MEMS data sheets give 0.003; ten "
        "times that covers vibration. What the samples themselves show is added to it.",
    )
    gyro_noise_rad_s_sqrt_hz: PositiveFloat = Field(
        0.001,
        description="Least noise density of the angular rate. MEMS data sheets give 0.0001; ten "
        "times that covers vibration. What the samples themselves show is added to it.",
    )
    scale_error: PositiveFloat = Field(
        0.005,
        description="Scale and misalignment of the IMU as a fraction of the signal (data sheets: "
        "0.2 to 1 %), taken as noise correlated over one second.",
    )
    acc_walk_m_s2_sqrt_s: PositiveFloat = Field(
        0.003,
        description="Random walk of a healthy accelerometer's bias: 0.03 m/s^2 in 100 s.",
    )
    gyro_walk_rad_s_sqrt_s: PositiveFloat = Field(
        0.0002, description="Random walk of a healthy gyro's bias: 0.1 deg/s in 100 s."
    )
    acc_turn_on_m_s2: PositiveFloat = Field(
        0.3, description="Turn-on bias of a healthy accelerometer, 1 sigma: no fault."
    )
    gyro_turn_on_rad_s: PositiveFloat = Field(
        0.01, description="Turn-on bias of a healthy gyro, 1 sigma: no fault."
    )
    gps_std_m_s: PositiveFloat = Field(
        0.12,
        description="Satellite velocity, 1 sigma north and east; the receiver's own accuracy is "
        "used where it states a worse one. From the recorded flights of the algorithm note "
        "(0.12 to 0.2).",
    )
    gps_down_std_m_s: PositiveFloat = Field(0.3, description="Satellite velocity, 1 sigma down.")
    baro_std_m: PositiveFloat = Field(
        0.4, description="White noise of the static-pressure height (algorithm note: 0.3 to 0.4)."
    )
    baro_error_m: PositiveFloat = Field(
        3.0, description="Slow error of the static-pressure height, correlated over 40 s."
    )
    tilt_std_rad: PositiveFloat = Field(0.005, description="White noise of ATTITUDE roll, pitch.")
    tilt_error_rad: PositiveFloat = Field(
        0.015, description="Slow error of ATTITUDE roll and pitch, correlated over 30 s."
    )
    heading_std_rad: PositiveFloat = Field(0.01, description="White noise of ATTITUDE yaw.")
    heading_error_rad: PositiveFloat = Field(
        0.05, description="Slow error of ATTITUDE yaw, correlated over 60 s."
    )
    slip_std_rad: PositiveFloat = Field(
        0.05, description="Sideslip of a flying aircraft, 1 sigma: coordinated within 3 degrees."
    )
    gust_std_m_s: PositiveFloat = Field(1.0, description="Lateral gusts, 1 sigma.")
    wind_std_m_s: PositiveFloat = Field(8.0, description="Wind, 1 sigma each of north and east.")
    window_s: tuple[PositiveFloat, ...] = Field(
        (1.6, 4.8, 14.4, 43.2),
        max_length=MAX_WINDOWS // 2,
        description="Lengths over which a step is looked for: abrupt and large to slow and small.",
    )
    difference_sigma: PositiveFloat = Field(
        6.0,
        description="Two IMUs disagree beyond this. The differences are normal to 1.7 sigma in "
        "the calm recorded flight; 6 leaves room for tails.",
    )
    single_sigma: PositiveFloat = Field(
        6.0,
        description="A lone IMU is blamed by the filter without the vehicle's attitude beyond "
        "this. The largest in the calm recorded flight is 2.3.",
    )
    acc_size_m_s2: PositiveFloat = Field(
        0.35, description="Nothing smaller is called an accelerometer fault."
    )
    gyro_size_rad_s: PositiveFloat = Field(
        0.012, description="Nothing smaller is called a gyro fault (0.7 deg/s)."
    )
    arbitration_nats: PositiveFloat = Field(
        8.0,
        description="Log likelihood ratio at which one of two disagreeing IMUs is blamed: odds of "
        "3000 to 1 in theory; weak evidence was wrong in 7 to 14 % (algorithm note).",
    )
    noise_ratio: PositiveFloat = Field(
        16.0,
        description="A noise fault multiplies the rms second difference of one axis by this "
        "against the other axes or the other IMU; healthy IMUs on rough mounts reach 12 "
        "(algorithm note).",
    )
    confirm_s: PositiveFloat = Field(0.4, description="A test must hold this long: two GPS fixes.")
    undecided_s: PositiveFloat = Field(
        15.0,
        description="Two IMUs that disagree are both suspect; without a verdict on one of them "
        "after this time they are unmonitored, as no reference tells.",
    )
    clear_s: PositiveFloat = Field(
        8.0, description="Agreement must last this long before an axis is re-admitted."
    )
    learn_s: PositiveFloat = Field(
        1.5,
        description="Time from alignment to the first verdict: the covariance is honest from the "
        "start, only transients of the alignment must pass.",
    )
    max_rate_rad_s: PositiveFloat = Field(
        2.5, description="Faster turning is beyond the model: nothing is judged for 3 s."
    )
