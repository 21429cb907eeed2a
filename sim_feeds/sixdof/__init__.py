"""The six-degree-of-freedom vehicle: an aircraft with forces and moments, flown by JSBSim.

Truth from another engine cannot share the mistakes of an estimator's prediction model. It needs the
extra ``sim``; without it :class:`EngineMissing` says so.

    from sim_feeds.sixdof import WingFault, fly_aerosonde

    flight = fly_aerosonde([WingFault("right.lift", 100.0, 10.0)], seed=1, wind_share=0.22)
    flight.t_s, flight.vel_ned_m_s, flight.fault_percent      # 300 s, a row each 50 ms
"""

from sim_feeds.sixdof.aerosonde import WingFault, fly_aerosonde
from sim_feeds.sixdof.engine import AircraftMissing, Engine, EngineMissing
from sim_feeds.sixdof.flight import FAULT_COLUMNS, SixDofFlight, consistency

__all__ = [
    "FAULT_COLUMNS",
    "AircraftMissing",
    "Engine",
    "EngineMissing",
    "SixDofFlight",
    "WingFault",
    "consistency",
    "fly_aerosonde",
]
