"""Settings of the engine watch: channels, shafts, the engine's model, and what a verdict takes."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from links.catalog import MAX_INSTANCES
from monitor.settings.base import Section

__all__ = ["ChannelSettings", "EngineSettings", "SingleShaftSettings", "TwoSpoolSettings"]

N_SHAFTS = 4
MAX_CHANNELS = 8
"""Channels of one model: every combination of working and faulty ones is weighed."""


class ChannelSettings(Section):
    """One engine-speed channel. Where it comes from is said in ``[links.spools]``."""

    shaft: int = Field(
        0, ge=0, lt=N_SHAFTS, description="Which shaft's speed it measures; 0 is the first."
    )
    range_rpm: float = Field(
        gt=0, description="Largest speed that it can show [rpm]; beyond it a reading is wrong."
    )
    noise_rpm: float = Field(gt=0, description="Standard deviation of its readings [rpm].")
    fault_probability: float = Field(
        0.01, gt=0, lt=0.5, description="Prior probability that a reading of it is wrong."
    )


class SingleShaftSettings(Section):
    """One shaft of a piston or electric engine: speed follows throttle and airspeed.

    tau dN/dt = c0 + c1 t + c2 t^2 + c3 V + c4 t V - N, t the throttle from 0 to 1, V the airspeed.
    All of it is learnt: ``mavsentry learn engine``.
    """

    time_constant_s: float = Field(0.3, gt=0, le=60, description="tau [s].")
    coefficients: tuple[float, float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        description="c0 [rpm], c1 [rpm], c2 [rpm], c3 [rpm per m/s], c4 [rpm per m/s].",
    )
    error_rpm: float = Field(
        100.0, gt=0, description="Standard deviation of what the model does not explain [rpm]."
    )
    error_time_s: float = Field(2.0, gt=0, description="How long such an error lasts [s].")


class TwoSpoolSettings(Section):
    """A jet of two spools, linear: the bundled one is wang2020's, eq. (19), a Tumansky R11-F300.

    x+ = A x + B u over one sample; x: speeds of low and high pressure spool, u: fuel flow and
    nozzle area, all as shares of their design limits.
    """

    a: tuple[tuple[float, float], tuple[float, float]] = Field(
        ((0.9683, 0.0094), (0.0124, 0.9781)), description="A, speeds to speeds."
    )
    b: tuple[tuple[float, float], tuple[float, float]] = Field(
        ((0.0112, 0.0188), (0.0091, 0.0001)), description="B, fuel flow and nozzle area to speeds."
    )
    sample_s: float = Field(0.01, gt=0, description="Sample time of A and B [s].")
    process_std: float = Field(
        0.01, gt=0, description="Standard deviation of each speed's noise in one sample."
    )
    full_scale_rpm: tuple[float, float] = Field(
        (11000.0, 11500.0), description="Design limits of the two speeds [rpm]."
    )
    nozzle_channel: int = Field(
        0, ge=0, le=16, description="Servo output of the nozzle; 0: it stands at nozzle_area."
    )
    nozzle_area: float = Field(0.5, ge=0, le=1, description="Share of the nozzle's largest area.")


class EngineSettings(Section):
    """What is known of the engine, and what is asked before a channel is blamed.

    A channel that is not listed under ``channels`` is watched all the same, against throttle and
    flight: whether it is dead or stuck. More needs a model.
    """

    model: Literal["none", "single-shaft", "two-spool"] = Field(
        "none", description="How the listed channels' shafts follow throttle and airspeed."
    )
    channels: dict[str, ChannelSettings] = Field(
        default_factory=dict, description="Engine-speed channel (spool0 ...) -> what it measures."
    )
    single_shaft: SingleShaftSettings = SingleShaftSettings()
    two_spool: TwoSpoolSettings = TwoSpoolSettings()
    throttle_channels: tuple[int, ...] = Field(
        (),
        max_length=N_SHAFTS,
        description="Servo output of each shaft's throttle; one serves all. Empty: the output "
        "whose SERVOn_FUNCTION says throttle, 3 while no such parameter was heard.",
    )
    throttle_idle_us: float = Field(
        1000.0, ge=500, le=2500, description="Pulse at throttle 0, without SERVOn_MIN [us]."
    )
    throttle_full_us: float = Field(
        2000.0, ge=500, le=2500, description="Pulse at throttle 1, without SERVOn_MAX [us]."
    )
    tick_s: float = Field(
        0.05, ge=0.01, le=0.5, description="Step of the engine's estimate and of the decisions [s]."
    )
    timing_s: float = Field(
        0.3,
        gt=0,
        description="How old a reading may be when it comes, against the throttle's [s]: RPM, "
        "EFI_STATUS and ESC_TELEMETRY carry no time of their own.",
    )
    memory_s: float = Field(
        0.5, gt=0, description="Time over which a channel's credit follows its readings [s]."
    )
    wrong_share: float = Field(
        0.1,
        gt=0,
        lt=1,
        description="Share of wrong readings over wrong_s at which a channel is faulty: half of "
        "the intermittent fault that is to be found.",
    )
    wrong_s: float = Field(10.0, gt=0, description="Averaging time of that share [s].")
    least_wrong: int = Field(
        3, ge=1, description="And so many readings must have been wrong, count."
    )
    readmit_s: float = Field(
        15.0, gt=0, description="How long a faulty channel must agree without a break [s]."
    )
    stuck_s: float = Field(
        4.0,
        gt=0,
        description="A reading that has not changed to the last bit for so long while the throttle "
        "moved is stuck [s].",
    )
    moved_share: float = Field(
        0.15, gt=0, lt=1, description="By so much the throttle must have moved, share of travel."
    )
    tied_share: float = Field(
        0.6,
        gt=0,
        lt=1,
        description="Share of a speed's variance that the throttle must explain before a channel "
        "without a model is judged by it: lift motors and constant-speed propellers are not.",
    )
    dead_share: float = Field(
        0.15,
        gt=0,
        lt=1,
        description="A reading below this share of the usual one is a dead channel or a stopped "
        "engine. The aircraft's energy says which.",
    )
    low_share: float = Field(
        0.08,
        gt=0,
        lt=1,
        description="With a model: so far below it, as a share of the range, all channels of a "
        "shaft must read before a stopped engine is thought of.",
    )
    decide_margin: float = Field(
        3.0,
        gt=0,
        description="Log odds at which it is settled whether the engine stopped or its channels "
        "failed: 20 to 1.",
    )
    decide_information: float = Field(
        5.0,
        gt=0,
        description="And so much the throttle must have let the aircraft's energy tell, log odds "
        "to be expected: a few seconds at cruise, for ever at idle.",
    )
    stop_probability: float = Field(
        1e-3,
        gt=0,
        lt=0.5,
        description="Prior probability of an engine stopping at the moment its speed falls.",
    )
    glide_ratio: float = Field(
        10.0, gt=1, description="Airspeed over sink rate without power, roughly."
    )
    power_time_s: float = Field(
        3.0, gt=0, description="Averaging time of the power from energy, and of its noise [s]."
    )
    no_power_s: float = Field(
        6.0,
        gt=0,
        description="Without an engine speed: how long the aircraft must lose energy like a glider "
        "although the throttle is open [s].",
    )
    no_power_throttle: float = Field(
        0.6, gt=0, lt=1, description="Throttle that is open in this sense, share of travel."
    )
    cut_s: float = Field(
        5.0,
        gt=0,
        description="How long the throttle output must stand idle while the autopilot misses "
        "airspeed and height before its engine is called cut [s].",
    )
    emit_s: float = Field(0.2, ge=0.1, description="Time between two estimates [s].")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        known = tuple(f"spool{i}" for i in range(MAX_INSTANCES["spool"]))
        for name, channel in self.channels.items():
            if name not in known:
                raise ValueError(f"{name} is no engine-speed channel; they are spool0 to spool15")
            if self.model == "two-spool" and channel.shaft > 1:
                raise ValueError(f"{name} measures shaft {channel.shaft} of a two-spool engine")
        if len(self.channels) > MAX_CHANNELS:
            raise ValueError(f"{len(self.channels)} channels; at most {MAX_CHANNELS} are weighed")
        if self.model == "single-shaft" and not any(self.single_shaft.coefficients):
            raise ValueError("model single-shaft has no coefficients: run mavsentry learn engine")
        ratio = self.tick_s / self.two_spool.sample_s
        if self.model == "two-spool" and abs(ratio - round(ratio)) > 1e-6:
            raise ValueError(f"tick_s = {self.tick_s} is not a multiple of two_spool.sample_s")
        if self.throttle_idle_us == self.throttle_full_us:
            raise ValueError("throttle_idle_us and throttle_full_us are equal")
        if any(not 1 <= c <= 16 for c in self.throttle_channels):
            raise ValueError("throttle_channels are servo outputs 1 to 16")
        return self
