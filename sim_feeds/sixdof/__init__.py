"""The six-degree-of-freedom vehicle: an aircraft with forces and moments, flown by JSBSim.

Truth from another engine cannot share the mistakes of an estimator's prediction model. It needs the
extra ``sim``; without it :class:`EngineMissing` says so.

    from sim_feeds.sixdof import WingFault, fly_aerosonde

    flight = fly_aerosonde([WingFault("right.lift", 100.0, 10.0)], seed=1, wind_share=0.22)
    flight.t_s, flight.vel_ned_m_s, flight.fault_percent      # 300 s, a row each 50 ms

:func:`fly_aerosonde` gives the flights of samar2006. As a MAVLink vehicle with instruments, and
with any aircraft of JSBSim, :func:`fly_circuit` flies: a scenario names the aircraft.

    mavsentry feed aerosonde-right-lift            # bundled scenarios: aerosonde-*
    mavsentry feed demo --aircraft c172p           # another's sensors, wind and faults

=============  =====================================================================================
in a scenario  with six degrees of freedom
=============  =====================================================================================
aircraft       aerosonde, c172p, A320 ...; those of ``CRUISE`` know their airspeed and height
start          speed_m_s and agl_m are held; another aircraft than those of ``CRUISE`` needs both
circuit        instead of legs: duration_s, waypoints_m
wind           every kind; what depends on height is that of the height to hold
rpm            speed sensors per shaft: spool0 is the first of shaft 0, the next its twin or, with
               one sensor each, shaft 1; N1 and N2 of a jet are two shafts
fault          besides those of sensors: spool0 (dead, stuck, intermittent ...), wing_left.lift and
               its like in percent (bias, drift; Aerosonde only), engine0 (stop)
=============  =====================================================================================

Servo outputs 1 to 4 are aileron, elevator, throttle and rudder: 400 us from trim are full travel,
half a radian on the Aerosonde, and a longer pulse turns right wing down, nose down, nose left.
"""

from sim_feeds.sixdof.aerosonde import WingFault, fly_aerosonde
from sim_feeds.sixdof.engine import AircraftMissing, Engine, EngineMissing
from sim_feeds.sixdof.flight import FAULT_COLUMNS, SixDofFlight, consistency
from sim_feeds.sixdof.vehicle import CRUISE, VehicleFlight, fly_circuit

__all__ = [
    "CRUISE",
    "FAULT_COLUMNS",
    "AircraftMissing",
    "Engine",
    "EngineMissing",
    "SixDofFlight",
    "VehicleFlight",
    "WingFault",
    "consistency",
    "fly_aerosonde",
    "fly_circuit",
]
