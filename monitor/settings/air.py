"""Settings of the deployed air-data monitor: one to three pitots, no vanes."""

from typing import Literal

from pydantic import Field

from monitor.settings.base import Section
from monitor.settings.horizon import HorizonSettings

__all__ = ["AirSettings"]

_NOTE = "From a published trial on recorded flights: "


class AirSettings(Section):
    """The filters' model, their noise, the fast checks and the limits of a verdict."""

    method: Literal["auto", "bank", "triplex"] = Field(
        "auto",
        description="Filter bank (wind and GPS as witnesses), triplex vote, or whichever suits the "
        "number of sensors.",
    )

    # The filters' model.
    wind_walk_m_s: float = Field(
        0.10,
        gt=0,
        description="Random walk of the horizontal wind [m/s per sqrt(s)]. " + _NOTE + "0.10.",
    )
    wind_shear_m_s: float = Field(
        1.2,
        ge=0,
        description="Random walk of the wind with height h, divided by sqrt(h) [m/s]: about 1 m/s "
        "over a doubling of height, the logarithmic profile of 10 m/s at 100 m over grassland.",
    )
    gust_tau_s: float = Field(
        5.0,
        gt=0,
        description="Time constant of a gust [s], as of Dryden turbulence at 20 m/s. On synthetic "
        "flights the scale's error at the time it is called learnt is 1.0 of its own sigmas with "
        "5 s, 1.2 (small aircraft) and 2.1 (light ones) with 10 s.",
    )
    scale_walk: float = Field(
        1e-3, gt=0, description="Random walk of a pitot's log-scale [1/sqrt(s)]. " + _NOTE + "1e-3."
    )
    scale_walk_shifted: float = Field(
        1e-2,
        gt=0,
        description="The same for a pitot held for broken [1/sqrt(s)]: 10 % in 100 s, the ramp "
        "that no autopilot reports.",
    )
    wind_prior_m_s: float = Field(
        8.0,
        gt=0,
        description="Standard deviation of the wind before take-off [m/s]. "
        + _NOTE
        + "8 m/s for small aircraft.",
    )
    vertical_walk_m_s: float = Field(
        0.02,
        gt=0,
        description="Random walk of the mean vertical wind [m/s per sqrt(s)]; thermals are gusts.",
    )
    vertical_prior_m_s: float = Field(
        0.5,
        gt=0,
        description="Standard deviation of the mean vertical wind [m/s]: continuity "
        "lets no large area rise or sink faster.",
    )
    wind_max_m_s: float = Field(
        30.0, gt=0, description="Horizontal wind beyond which no explanation is believed [m/s]."
    )
    wind_down_max_m_s: float = Field(
        8.0,
        gt=0,
        description="The same for the vertical wind [m/s]: strong thermals and lee waves.",
    )
    wind_change_max_m_s: float = Field(
        10.0,
        gt=0,
        description="Change of the horizontal wind within wind_change_base_s beyond which no "
        "explanation is believed [m/s]: the gust front of a thunderstorm.",
    )
    wind_change_base_s: float = Field(
        20.0,
        gt=0,
        description="Time base of wind_change_max_m_s [s]; over longer times the bound grows with "
        "the square root of the time.",
    )
    scale_prior: float = Field(
        0.12,
        gt=0,
        description="Standard deviation of a pitot's log-scale before it is learnt: healthy "
        "aircraft span +-15 %.",
    )
    yaw_prior_rad: float = Field(
        0.03, gt=0, description="Standard deviation of the yaw offset [rad]. " + _NOTE + "0.03."
    )
    gate_sigma: float = Field(
        3.0, gt=1, description="Innovation beyond which a measurement loses weight (Huber)."
    )

    # Noise.
    gust_prior_m_s: float = Field(
        1.5,
        gt=0,
        description="Gust intensity assumed at take-off, until the slip tells [m/s]. The upper end "
        "of what recorded flights show: too small a value passes gusts off for knowledge.",
    )
    gust_min_m_s: float = Field(
        0.3,
        gt=0,
        description="Least gust intensity that is believed [m/s]. Recorded flights show 0.3 to "
        "1.5, the simulator only 0.1 to 0.25.",
    )
    gust_max_m_s: float = Field(6.0, gt=0, description="Greatest gust intensity [m/s].")
    sideslip_rad: float = Field(
        0.05,
        gt=0,
        description="Sideslip of coordinated flight, beyond what gusts make of it [rad]. "
        + _NOTE
        + "0.06, gusts included.",
    )
    timing_s: float = Field(
        0.08, ge=0, description="Uncertainty of the GPS latency between autopilots [s]."
    )
    pitot_common: float = Field(
        0.01, gt=0, description="Relative noise that all pitots share: position error, incidence."
    )
    pitot_own: float = Field(0.006, gt=0, description="Relative noise of each pitot's own.")

    # The explanations under test.
    jump_scale: float = Field(
        1.0, gt=0, description="Standard deviation of a pitot's shift [1, logarithm]."
    )
    jump_wind_m_s: float = Field(
        6.0, gt=0, description="Standard deviation of a change of wind [m/s]."
    )
    spawn_s: float = Field(1.0, gt=0, description="Time between starts of explanations [s].")
    age_max_s: float = Field(
        150.0, gt=10, description="Oldest start of an explanation [s]. " + _NOTE + "150 s."
    )

    # The reference.
    reference_gap_s: float = Field(
        2.5, gt=0, description="Silence of GPS or attitude after which nothing is judged [s]."
    )
    reference_apart_m_s: float = Field(
        1.5,
        gt=0,
        description="Lasting difference of GPS and autopilot velocity beyond which neither is "
        "trusted [m/s]. A GPS latency wrong by 0.1 s gives 0.5 m/s in a 30 degree turn.",
    )
    reference_noise_m_s: float = Field(
        0.8,
        gt=0,
        description="White noise of GPS velocity, beyond what the autopilot's velocity shows too, "
        "at which it is not trusted [m/s]. A receiver with a fix has 0.05 to 0.2.",
    )
    reference_wait_s: float = Field(
        5.0, ge=0, description="How long they must agree again before judging goes on [s]."
    )

    # Verdicts.
    margin_one: float = Field(
        8.0,
        gt=0,
        description="Log-likelihood margin that accuses one of several pitots. " + _NOTE + "8.",
    )
    margin_all: float = Field(
        15.0,
        gt=0,
        description="The same for all of several pitots, or the last that is left of them. "
        + _NOTE
        + "15.",
    )
    margin_single: float = Field(
        6.0,
        gt=0,
        description="The same for a pitot that is alone: twice what 18 h of synthetic flights with "
        "nothing broken reached, 3.0; changes of wind of 2 to 8 m/s in flight reach 8.",
    )
    margin_wind: float = Field(
        6.0, gt=0, description="Margin at which a changed wind is accepted; it accuses nobody."
    )
    confirm_s: float = Field(
        1.0, ge=0, description="How long a margin must hold [s]. " + _NOTE + "1 s."
    )
    min_shift: float = Field(
        0.075,
        gt=0,
        description="Least shift called a fault [1, logarithm]: half of what healthy installations "
        "span.",
    )
    learnt_scale_std: float = Field(
        0.045,
        gt=0,
        description="A pitot is judged once its log-scale is known so well. "
        + _NOTE
        + "0.045, reached in the first turn.",
    )
    learn_s: float = Field(
        15.0, ge=0, description="And once it has flown so long [s]: take-off is no straight flight."
    )
    lost_scale_std: float = Field(
        0.07, gt=0, description="It is judged no more when its log-scale is known worse than this."
    )
    readmit_shift: float = Field(
        0.04, gt=0, description="A faulty pitot recovers within this of its old log-scale."
    )
    readmit_unlearnt_shift: float = Field(
        0.15, gt=0, description="The same where no old scale was learnt: the healthy span."
    )
    readmit_s: float = Field(
        10.0,
        gt=0,
        description="How long it must agree, doubled by every re-admission of the flight [s].",
    )
    suspect_clear_s: float = Field(
        5.0, ge=0, description="Suspicion ends so long after its last grounds [s]."
    )

    # Beside the filter bank.
    horizon: HorizonSettings = Field(
        default_factory=HorizonSettings, description="Minutes of flight, for slow faults."
    )

    # Fast checks.
    constant_s: float = Field(
        2.0,
        gt=0,
        description="A pitot constant to the last bit for so long is stuck [s]. "
        + _NOTE
        + "2 s, as PX4 has it.",
    )
    gross_ln: float = Field(0.5, gt=0, description="Gross error [1, logarithm]. " + _NOTE + "0.5.")
    gross_s: float = Field(
        1.0, gt=0, description="How long a gross error must last [s]. " + _NOTE + "1 s."
    )
    dead_wind_m_s: float = Field(
        12.0,
        gt=0,
        description="Ground speed less 1.2 times airspeed that only a dead pitot explains, while "
        "the wind is not known [m/s]. " + _NOTE + "12 m/s for small aircraft.",
    )
    dead_s: float = Field(2.0, gt=0, description="How long that must last [s]. " + _NOTE + "2 s.")
    noise_rms: float = Field(
        0.03,
        gt=0,
        description="Sample-to-sample noise of a broken pitot, of its airspeed [1]: "
        "ten times the 0.3 % of a healthy one at 18 m/s.",
    )
    noise_ratio: float = Field(
        0.5,
        gt=0,
        description="And so many times the scatter, gusts included, of the quietest other pitot.",
    )
    noise_s: float = Field(1.0, gt=0, description="How long the noise must last [s].")
    noise_tau_s: float = Field(1.0, gt=0, description="Averaging time of the noise [s].")
