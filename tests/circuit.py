"""A short circuit in a steady wind: the flight that several scenarios of the tests make."""


def circuit(last_leg_s: float) -> str:
    """Start, legs and wind as TOML: turns both ways and a climb, then a leg so long [s]."""
    return f"""\
[start]
speed_m_s = 20.0
agl_m = 150.0

[[leg]]
do = "level"
duration_s = 15.0
[[leg]]
do = "turn"
angle_deg = 180.0
[[leg]]
do = "climb"
rate_m_s = 1.5
duration_s = 15.0
[[leg]]
do = "turn"
angle_deg = -180.0
[[leg]]
do = "level"
duration_s = {last_leg_s}

[[wind]]
kind = "constant"
speed_m_s = 4.0
toward_deg = 60.0
"""
