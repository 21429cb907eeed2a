"""How a stream is read, whose it is, and what is remembered of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from links import catalog

__all__ = ["DecoderMemory", "DecoderOptions", "Vehicle"]


@dataclass(frozen=True, slots=True)
class DecoderOptions:
    """How a stream is read; the defaults suit ArduPilot and PX4.

    Attributes
    ----------
    dialect
        MAVLink dialect that pymavlink ships.
    system_id
        The vehicle; None takes the first that sends an autopilot's HEARTBEAT.
    autopilot_component
        Component that sensors are taken from and whose stamps make the clock.
    own_component
        What carries this component id of the vehicle's system is our own output, never an input.
    components
        Message -> component ids to take it from, where not the autopilot's alone.
    ranking
        Quantity -> source keys, best first; see :meth:`ranked`.
    spools
        Engine-speed channel -> (part of a message, rpm per unit), see
        :mod:`links.spool_sources`; when any is given, those of the catalogue are not used.
    named_inputs
        NAMED_VALUE_FLOAT name -> (sensor, field, factor to SI).
    airspeed_ratio
        ARSPD_RATIO until a PARAM_VALUE tells it.
    source_timeout_us
        Silence of a source after which the next in rank steps in [us].
    settle_us
        Time before a synthetic source (VFR_HUD.airspeed) is used [us].
    hold_back
        Bound of what is kept until the vehicle is known [frames].
    """

    dialect: str = "ardupilotmega"
    system_id: int | None = None
    autopilot_component: int = 1
    own_component: int = 191
    components: Mapping[str, frozenset[int]] = field(default_factory=dict)
    ranking: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    named_inputs: Mapping[str, tuple[str, str, float]] = field(
        default_factory=lambda: dict(catalog.NAMED_INPUTS)
    )
    spools: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    airspeed_ratio: float = 2.0
    source_timeout_us: int = 2_000_000
    settle_us: int = 2_000_000
    hold_back: int = 8192

    def ranked(
        self, ranking: Mapping[str, tuple[str, ...]], sources: Iterable[catalog.Source]
    ) -> dict[str, tuple[str, ...]]:
        """A format's ranking, with what was chosen in place of its own.

        One choice may name messages of several formats. Of those that this format has the order
        counts; where it has none of them, its own ranking stands.

        Parameters
        ----------
        ranking
            Quantity -> keys of the format, best first.
        sources
            All that the format can give.
        """
        known: dict[str, set[str]] = {}
        for source in sources:
            known.setdefault(source.quantity, set()).add(source.key)
        out = dict(ranking)
        for quantity, keys in self.ranking.items():
            if own := tuple(key for key in keys if key in known.get(quantity, ())):
                out[quantity] = own
        return out


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Who is watched: MAVLink system id, MAV_AUTOPILOT and MAV_TYPE numbers."""

    system_id: int
    autopilot: int
    type: int


class DecoderMemory(NamedTuple):
    """What a decoder must remember so that another one can go on where it stopped.

    Attributes
    ----------
    vehicle
        Whose it is.
    clock : (m,) int64
        :attr:`links.clock.VehicleClock.state`.
    counts : (2,) int64
        Number of the next row; time of the first stamp [us].
    remembered : (s,) int64
        When each source spoke last, and how often; see :attr:`links.mavlink.plan.Plan.remembered`.
    ratios : (3,) float64
        ARSPD_RATIO of each pitot.
    """

    vehicle: Vehicle
    clock: NDArray[np.int64]
    counts: NDArray[np.int64]
    remembered: NDArray[np.int64]
    ratios: NDArray[np.float64]
