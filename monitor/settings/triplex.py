"""Settings of the triplex air-data watch: two or three pitots, two or three vanes."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["TriplexSettings"]

_SYNTHETIC = "Fitted on healthy synthetic flights of three aircraft classes in turbulence."


class TriplexSettings(Section):
    """Thresholds of the votes, the bounds on the wind, and the model's noise."""

    # Sensors of a kind against each other.
    aoa_threshold_deg: float = Field(
        1.2,
        gt=0,
        description="Difference of a vane from the others that is called a fault, mean of 1 s "
        "[deg]. Six times the scatter of three vanes with 0.2 deg of noise; below the 2.9 deg of "
        "wan2018, which must also cover gusts.",
    )
    cas_threshold_m_s: float = Field(
        1.5,
        gt=0,
        description="Least difference of a pitot from the others that is called a fault [m/s]. "
        + _SYNTHETIC,
    )
    cas_threshold_share: float = Field(
        0.03,
        gt=0,
        description="The same as a share of the airspeed [1]: healthy calibrations differ by 1 to "
        "2 %, of which most is learnt.",
    )
    learnt_sigmas: float = Field(
        6.0,
        gt=0,
        description="A threshold is at least this many times the rms learnt while all agreed [1], "
        "and at most three times its floor.",
    )
    ragged_share: float = Field(
        0.65,
        gt=0,
        description="Threshold of the rms over 1 s (noise, oscillation) as a share of that of the "
        "mean [1].",
    )
    offset_limit_deg: float = Field(
        1.5, ge=0, description="Largest constant offset of a vane that is learnt [deg]."
    )
    scale_limit: float = Field(
        0.05, ge=0, description="Largest calibration error of a pitot that is learnt [1]."
    )
    lever_arm_m: float = Field(
        1.0,
        ge=0,
        description="Distance of vanes and pitots from the roll axis [m]: a roll sets them apart "
        "by rate times arm over airspeed.",
    )
    learn_s: float = Field(
        15.0, gt=0, description="Time after take-off before a sensor is judged [s]."
    )
    memory_s: float = Field(
        60.0,
        gt=0,
        description="Memory of the learnt offsets [s]: a slow drift of 0.5 kt/s or 0.2 deg/s "
        "outruns it.",
    )
    constant_s: float = Field(
        2.0, gt=0, description="An unchanged reading while the others move is stuck after this [s]."
    )
    clear_share: float = Field(
        0.6, gt=0, le=1, description="A latched sensor agrees below this share of the threshold."
    )
    clear_s: float = Field(
        10.0, gt=0, description="A latched sensor comes back after agreeing this long [s]."
    )
    vote_wait_s: float = Field(
        5.0,
        gt=0,
        description="The remembered wind must favour two against the third; if it is undecided for "
        "this long, the two are believed [s].",
    )
    pair_wait_s: float = Field(
        3.0, gt=0, description="Two that disagree this long without a culprit are suspect [s]."
    )

    # All of them against the bounded wind.
    common_aoa_deg: float = Field(
        4.0,
        gt=0,
        description="Difference of all vanes from the bounded horizon that convicts them [deg]: "
        "wan2018's 2.9 and a degree for turns and attitude errors; healthy ones stay within 1.",
    )
    common_cas_m_s: float = Field(
        4.0,
        gt=0,
        description="The same of all pitots [m/s]; for a transport wan2018's 12 kt. " + _SYNTHETIC,
    )
    common_cas_share: float = Field(
        0.06, gt=0, description="The same at least as a share of the airspeed [1]."
    )
    wind_bound_m_s: float = Field(
        25.0,
        gt=0,
        description="Largest horizontal wind [m/s]; for a transport wan2018's 120 kt.",
    )
    wind_bound_down_m_s: float = Field(
        8.0,
        gt=0,
        description="Largest vertical wind [m/s]; for a transport 25 kt, which finds vanes that "
        "drift together.",
    )
    wind_change_m_s: float = Field(
        8.0,
        gt=0,
        description="Largest change of the horizontal wind within wind_change_base_s [m/s]: "
        "turbulence of 1.5 m/s rms and a shear of 0.2 m/s per second keep it.",
    )
    wind_change_down_m_s: float = Field(
        6.0, gt=0, description="The same of the vertical wind [m/s]."
    )
    wind_change_base_s: float = Field(
        20.0, gt=0, le=100, description="Time base of the bounds on the wind's change [s]."
    )
    wind_walk_m_s: float = Field(
        0.8,
        gt=0,
        description="Random walk of the wind, gusts included [m/s per sqrt(s)]: Dryden turbulence "
        "of 1.3 m/s with a time constant of 5 s.",
    )
    wind_walk_down_m_s: float = Field(
        0.6, gt=0, description="The same of the vertical wind [m/s per sqrt(s)]."
    )
    wind_down_tau_s: float = Field(
        10.0, gt=0, description="Time constant with which the vertical wind is drawn to zero [s]."
    )
    held_walk_m_s: float = Field(
        0.1,
        gt=0,
        description="Random walk of the mean wind while no pitot is left [m/s per sqrt(s)]: from "
        "recorded flights.",
    )
    step_sigmas: float = Field(
        5.0,
        gt=0,
        description="A common step is called a fault beyond this many times the gusts' rms [1].",
    )
    gust_m_s: float = Field(
        1.0,
        gt=0,
        description="Least rms of gusts against the remembered wind [m/s]; more is learnt.",
    )

    # Who is right when votes and wind disagree: differences of squares over twice the gusts'
    # variance, a logarithm of odds.
    block_margin: float = Field(
        2.5,
        ge=0,
        description="A sensor that the remembered wind favours by this much is not voted out "
        "[log odds].",
    )
    majority_margin: float = Field(
        7.0,
        ge=0,
        description="By this much the other two are convicted instead [log odds]. " + _SYNTHETIC,
    )
    pair_margin: float = Field(
        3.0, ge=0, description="Of two that disagree, one is convicted by this much [log odds]."
    )

    # The references and the model's noise.
    attitude_gap_s: float = Field(
        0.6, gt=0, description="An attitude older than this is no reference [s]."
    )
    reference_gap_s: float = Field(
        2.0, gt=0, description="A ground velocity older than this is no reference [s]."
    )
    reference_apart_m_s: float = Field(
        6.0,
        gt=0,
        description="Ground velocity that far from the strapdown one is not trusted [m/s].",
    )
    reference_wait_s: float = Field(10.0, gt=0, description="And for this long afterwards [s].")
    velocity_walk_m_s: float = Field(
        0.5, gt=0, description="Random walk of the strapdown velocity [m/s per sqrt(s)]."
    )
    gps_std_m_s: float = Field(0.2, gt=0, description="Noise of a ground velocity [m/s].")
    cas_std_m_s: float = Field(0.8, gt=0, description="Noise of the fused airspeed [m/s].")
    aoa_std_deg: float = Field(0.6, gt=0, description="Noise of the fused angle of attack [deg].")
    sideslip_std_deg: float = Field(
        4.0, gt=0, description="Sideslip that an aircraft flies with [deg]."
    )
    offset_std_deg: float = Field(
        1.0, gt=0, description="Offset that all vanes may share, by the flow about them [deg]."
    )
    offset_walk_deg: float = Field(0.02, gt=0, description="Its random walk [deg per sqrt(s)].")
    emit_s: float = Field(0.1, gt=0, description="Interval of the published estimates [s].")

    # Errors that stay for minutes: they do not average out of the published air data.
    calibration_std: float = Field(
        0.05,
        ge=0,
        description="Calibration error of a pitot [1], each its own: small installations span "
        "+-15 %, those certified to 14 CFR 25.1323 3 %.",
    )
    heading_std_deg: float = Field(
        2.0, ge=0, description="Slow error of the heading [deg]: a magnetic compass."
    )
    alignment_std_deg: float = Field(
        0.2, ge=0, description="Alignment of a vane and error of its position [deg]."
    )
