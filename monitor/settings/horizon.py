"""Settings of the long horizon: minutes of wind and scale beside the filter bank's moments."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["HorizonSettings"]


class HorizonSettings(Section):
    """Stages, model, bounds and margins of the constrained long horizon."""

    horizon_s: float = Field(
        300.0,
        gt=30,
        description="Length of the horizon [s]: a leak of 2 %/min passes min_shift in 225 s.",
    )
    stage_s: float = Field(
        3.0,
        gt=0.5,
        le=6.0,
        description="Length of a stage [s]; a 30 degree bank turns 54 degrees in it at 18 m/s, "
        "which costs 4 % of its lateral information.",
    )
    solve_stages: int = Field(2, ge=1, description="Stages between two solves.")
    iterations: int = Field(
        1, ge=1, le=4, description="Linearisations of a solve; the last solve is the start."
    )
    gust_tau_s: float = Field(
        10.0,
        gt=0,
        description="Time constant of a gust [s]: 200 m of Dryden turbulence at 20 m/s.",
    )
    lateral_m_s: float = Field(
        0.2, gt=0, description="Slip that lasts through a stage [m/s]: 0.6 degrees at 18 m/s."
    )
    pitot_common: float = Field(
        0.005, gt=0, description="Relative error of all pitots that lasts through a stage."
    )
    pitot_own: float = Field(
        0.003, gt=0, description="Relative error of each pitot's own that lasts through a stage."
    )
    wind_walk_changed_m_s: float = Field(
        0.5,
        gt=0,
        description="Random walk of a wind that changes [m/s per sqrt(s)]: 9 m/s over the horizon.",
    )
    scale_walk: float = Field(
        5e-4,
        gt=0,
        description="Random walk of a sound pitot's log-scale [1/sqrt(s)]: 0.9 % over the horizon.",
    )
    rate_walk: float = Field(
        4e-5,
        gt=0,
        description="Random walk of a drift's rate [1/s per sqrt(s)]: 2.4 %/min within 100 s.",
    )
    down_max_m_s: float = Field(
        2.0, gt=0, description="Bound on the mean vertical wind over a stage [m/s]."
    )
    change_max_m_s: float = Field(
        15.0,
        gt=0,
        description="Bound on the change of each horizontal component of the wind over the "
        "horizon's length [m/s]: a front that turns 10 m/s by 90 degrees.",
    )
    scale_max: float = Field(
        0.7, gt=0, description="Bound on a pitot's log-scale: half to twice the truth."
    )
    margin_one: float = Field(
        10.0, gt=0, description="Log-likelihood margin that accuses one of several pitots."
    )
    margin_all: float = Field(
        12.0, gt=0, description="The same for a single pitot or for all of them."
    )
    margin_wind: float = Field(
        6.0, gt=0, description="Margin at which a changed wind is believed; it accuses nobody."
    )
    confirm_s: float = Field(
        1.0, ge=0, description="How long a margin must hold [s]: at least one solve more."
    )
    min_shift: float = Field(
        0.075, gt=0, description="Least change of scale over the horizon called a fault [1]."
    )
