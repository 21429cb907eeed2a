"""Short synthetic flights, each with one thing broken, as telemetry logs."""

from tests.circuit import circuit

FLIGHT = f"""\
title = "Two minutes of a small aircraft with two of each sensor"
aircraft = "small-uav"
seed = 7

{circuit(45.0)}
[imu]
count = 2

[airspeed]
count = 2
"""

FAULTS = {
    "healthy": "",
    "pitot": """
[[fault]]
sensor = "airspeed0"
kind = "drift"
rate_m_s_per_s = -0.8
limit_m_s = 9.0
start_s = 65.0
end_s = 85.0
""",
    "imu": """
[[fault]]
sensor = "imu0.acc_x"
kind = "bias"
size_m_s2 = 3.0
start_s = 60.0
end_s = 80.0
""",
    "dead": """
[[fault]]
sensor = "airspeed1"
kind = "dead"
start_s = 60.0

[[fault]]
sensor = "gps0"
kind = "dropout"
start_s = 95.0
""",
}
"""Name of the flight -> what breaks in it."""
