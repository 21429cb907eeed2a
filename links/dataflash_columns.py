"""What is read of a DataFlash log: columns of its messages, and the unit the catalogue expects."""

__all__ = [
    "ACC",
    "BIAS",
    "CHANNELS",
    "COLUMNS",
    "EKF2",
    "ESCS",
    "GYRO",
    "NAMED",
    "PARAMETER",
    "TEXT",
    "VEHICLE",
    "VELOCITY",
    "WHOLE",
]

PARAMETER, NAMED, TEXT = "PARM", "NVAL", "MSG"
VEHICLE = "(vehicle)"
"""What ``VER`` or ``MSG`` say of the vehicle's type, as the reader puts it."""

EKF2 = {"NKF1": "XKF1", "NKF4": "XKF4", "NKQ": "XKQ"}
"""Messages of the older filter, which are read as those of EKF3 where it alone ran."""

GYRO, ACC = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")
BIAS, VELOCITY = ("GX", "GY", "GZ"), ("VN", "VE", "VD")
CHANNELS = tuple(f"C{k}" for k in range(1, 17))
ESCS = tuple(f"ESC{k + 1}" for k in range(8))

_IMU_UNITS = {"I": "", **dict.fromkeys(GYRO, "rad/s"), **dict.fromkeys(ACC, "m/s/s")}
_GPS_UNITS = {
    "I": "",
    "Status": "",
    "NSats": "",
    "Lat": "deg",
    "Lng": "deg",
    "Alt": "m",
    "Spd": "m/s",
    "GCrs": "deg",
    "VZ": "m/s",
}
_GPA_UNITS = {"I": "", "HAcc": "m", "VAcc": "m", "SAcc": "m/s", "VV": ""}
_BARO_UNITS = {"I": "", "Press": "Pa", "Temp": ""}
_ARSP_UNITS = {"I": "", "DiffPress": "Pa", "U": "", "H": "", "Pri": ""}

COLUMNS: dict[str, dict[str, str]] = {
    **dict.fromkeys(("IMU", "IMU2", "IMU3"), _IMU_UNITS),
    "ATT": {"Roll": "deg", "Pitch": "deg", "Yaw": "deg"},
    "XKQ": {"C": "", "Q1": "", "Q2": "", "Q3": "", "Q4": ""},
    "XKF1": {"C": "", **dict.fromkeys(VELOCITY, "m/s"), **dict.fromkeys(BIAS, "deg/s")},
    "XKF4": {"PI": ""},
    **dict.fromkeys(("GPS", "GPS2"), _GPS_UNITS),
    **dict.fromkeys(("GPA", "GPA2"), _GPA_UNITS),
    "POS": {"Lat": "deg", "Lng": "deg", "Alt": "m", "RelHomeAlt": "m"},
    **dict.fromkeys(("ARSP", "ASP2"), _ARSP_UNITS),
    "CTUN": {"As": "m/s"},
    **dict.fromkeys(("BARO", "BAR2", "BAR3"), _BARO_UNITS),
    "RPM": {"I": "", "RPM": "rpm", "rpm1": "rpm", "rpm2": "rpm"},
    "EFI": {"Rpm": "rpm"},
    "ESC": {"Instance": "", "RPM": "rpm"},
    **{message: {"RPM": "rpm"} for message in ESCS},
    "RCOU": dict.fromkeys(CHANNELS, ""),
    "RCO2": {"C15": "", "C16": ""},
    "NTUN": {"AltE": "m", "AsE": "m/s"},
    "STAT": {"Armed": "", "isFlying": "", "Crash": ""},
    "MODE": {"ModeNum": ""},
    "VER": {"BU": ""},
    VEHICLE: {"Type": ""},
    PARAMETER: {"Name": "", "Value": ""},
    TEXT: {"Message": ""},
    NAMED: {"Name": "", "Value": "", "SCom": "", "SSys": ""},
}
"""Message -> column -> unit that the table expects, "" where none is converted."""

WHOLE = frozenset(
    {"I", "C", "PI", "Instance", "Status", "NSats", "VV", "U", "H", "Pri", "Armed"}
    | {"isFlying", "Crash", "ModeNum", "BU", "SCom", "SSys"}
)
"""Columns that count or name something and are of no use as fractions."""
