"""Settings of a vane beside the pitot bank: no second vane to be compared with."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["VaneSettings"]


class VaneSettings(Section):
    """Model of the vane and of the vertical wind, and the limits of a verdict."""

    offset_prior_deg: float = Field(
        4.0, gt=0, description="Offset of an installation before it is learnt [deg]."
    )
    scale_prior: float = Field(
        0.2,
        gt=0,
        description="What the upwash at a vane's place adds to its angle [1]: 0.1 to 0.3 at a "
        "nose or a wing.",
    )
    offset_walk_deg: float = Field(
        0.1,
        gt=0,
        description="Random walk of the offset [deg per sqrt(s)]: an attitude error of 0.6 deg "
        "that changes over a minute.",
    )
    shifted_walk_deg: float = Field(
        0.3,
        gt=0,
        description="The same of a vane held for broken [deg per sqrt(s)], so that drifts fit.",
    )
    gust_tau_s: float = Field(
        10.0, gt=0, description="Time constant of vertical gusts [s], as of horizontal ones."
    )
    noise_deg: float = Field(0.7, gt=0, description="Noise of a reading, and flow about it [deg].")
    timing_s: float = Field(
        0.1, ge=0, description="Uncertainty of the time between vane and attitude [s]."
    )
    jump_deg: float = Field(8.0, gt=0, description="Standard deviation of a vane's shift [deg].")
    margin: float = Field(
        15.0,
        gt=0,
        description="Log-likelihood margin that accuses a vane: that of a single pitot.",
    )
    confirm_s: float = Field(
        5.0,
        ge=0,
        description="How long it must hold [s]: an aircraft is through the edge and the core of "
        "most thermals.",
    )
    least_deg: float = Field(2.0, gt=0, description="Least shift called a fault [deg].")
    updraft_m_s: float = Field(
        3.0,
        gt=0,
        description="Vertical wind that may last [m/s]: a strong thermal. Smaller shifts, of "
        "its angle at this airspeed, are no faults.",
    )
    learn_s: float = Field(30.0, ge=10, description="Time of flight before a vane is judged [s].")
    learnt_deg: float = Field(1.5, gt=0, description="And its offset must be known so well [deg].")
    constant_s: float = Field(
        3.0,
        gt=0,
        description="A vane that has not changed to the last bit for so long while the angle of "
        "attack moved is stuck [s]; five times as long where it did not move.",
    )
    moved_deg: float = Field(1.0, gt=0, description="By so much it must have moved [deg].")
    scatter_deg: float = Field(
        2.0,
        gt=0,
        description="Scatter about its mean over scatter_s that is called noise or oscillation, "
        "rms [deg]: ten times a healthy vane's noise.",
    )
    scatter_ratio: float = Field(
        2.0, gt=0, description="And so many times the deviation that vertical gusts give."
    )
    scatter_s: float = Field(1.0, gt=0, description="Averaging time of it [s].")
    scatter_hold_s: float = Field(
        4.0, gt=0, description="How long it must last [s]: a single step is no scatter."
    )
    gross_deg: float = Field(
        15.0, gt=0, description="Difference that no flight explains [deg]: beyond the stall."
    )
    gross_s: float = Field(3.0, gt=0, description="How long that must last [s].")
    readmit_s: float = Field(
        10.0,
        gt=0,
        description="How long a faulty vane must agree, doubled by every re-admission [s].",
    )
