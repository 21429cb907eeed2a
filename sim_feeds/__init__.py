"""A synthetic vehicle: truth, what its sensors say, what breaks, and the MAVLink that follows.

From the bottom up, each layer usable alone:

=============  ====================================================================================
module         gives
=============  ====================================================================================
earth          rotating sphere, gravity, standard atmosphere, calibrated airspeed
airframe       three kinematic aircraft classes: transport, light-aircraft, small-uav
flightplan     manoeuvres, chained, as analytic profiles
wind           constant, ramp, shear, gust, Dryden turbulence
von_karman     turbulence by shaping filters
trajectory     ``fly(plan, wind) -> Truth``: exact arrays on an even grid
faults         every fault of the papers, and the pressure physics of blocked tubes
sensors        what the instruments of an aircraft deliver, with their errors and times
closed_loop    an aircraft whose autopilot steers on what its sensors say
papers         the experiments of the five papers as arrays
tachometer     engine-speed sensors of an aircraft whose engines turn
sixdof         the Aerosonde with wings that can be damaged, and any aircraft of JSBSim (extra
               ``sim``)
scenario       a flight, its instruments and faults as a TOML file
player         a scenario as the MAVLink frames of an autopilot, and the truth beside it
=============  ====================================================================================

Arrays for the papers' estimators, without MAVLink::

    from sim_feeds.papers.lu2016 import lu2016_experiment
    from sim_feeds.papers.wan import wan_experiment
    from sim_feeds.papers.wan2016 import table1

    e = lu2016_experiment("turbulence", seed=3)      # 40 s at 100 Hz, Table 2 faults 10-30 s
    e.u_m, e.y_ground, e.env, e.f, e.x_ground        # (4001, 6), (4001, 6), (4001, 2) ...
    e.x_air, e.y_air                                 # [u v w ...], [V alpha beta ...]

    w = table1().experiment("6", seed=1)             # row 6 of Table 1: two airspeeds run away
    w.theta, w.v_z_m_s, w.aoa_rad, w.cas_m_s         # a row each 0.048 s, 3 vanes, 3 airspeeds
    w.x, w.cas_true_m_s, w.faulty                    # truth

    from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
    fall = -15.0 * KNOT_M_S
    w = wan_experiment(
        [Fault(f"airspeed{i}", FaultKind.RUNAWAY, 20.0, rate=fall) for i in range(3)], seed=1
    )

A healthy experiment has no faults: ``lu2016_experiment(faults=[])``, ``wan_experiment([])``.
These flights are open loop: the aircraft flies its plan whatever its sensors say, as in the
open-loop validation of lu2016 section 3.2; no autopilot steers on a faulty reading. In the flights
of :mod:`sim_feeds.closed_loop` one does.

Everything random follows from ``seed``; the same seed gives the same bits.
"""
