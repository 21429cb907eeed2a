"""The closed lists every room speaks in: sensor states, fault kinds, reasons, rejections.

They are plain string enums so that a value prints, serialises and compares as the word itself.
"""

from enum import StrEnum

__all__ = ["GYRO_ACC_AXES", "Kind", "Phase", "Reason", "Rejection", "State"]


class State(StrEnum):
    """What the monitor says of one watched sensor."""

    OK = "ok"
    SUSPECT = "suspect"
    FAULTY = "faulty"
    STALE = "stale"
    ABSENT = "absent"
    UNMONITORED = "unmonitored"
    STOPPED = "stopped"
    """Of an engine: it gives no power although it should. The sensors that say so are healthy."""


class Kind(StrEnum):
    """The shape of a fault, as far as the evidence tells."""

    BIAS = "bias"
    DRIFT = "drift"
    OSCILLATION = "oscillation"
    STUCK = "stuck"
    SCALE = "scale"
    NOISE = "noise"
    DROPOUT = "dropout"
    RUNAWAY = "runaway"
    UNKNOWN = "unknown"


class Reason(StrEnum):
    """Why a sensor that sends data cannot be judged now."""

    ON_GROUND = "on ground"
    LEARNING = "learning"
    WIND_NOT_OBSERVABLE = "wind not observable"
    REFERENCE_MISSING = "reference missing"
    REFERENCE_NOT_TRUSTED = "reference not trusted"
    MANOEUVRE = "manoeuvre beyond the model"
    SENSORS_DISAGREE = "sensors disagree, none can be told wrong"
    NO_ENGINE_MODEL = "no engine model (mavsentry learn engine)"
    NO_AIRFRAME = "no airframe coefficients ([wing] airframe)"
    AIRFRAME_MISFIT = "airframe does not fit (mavsentry learn airframe)"
    MUTED = "muted by the operator"


class Rejection(StrEnum):
    """Why bytes, a message or a sample was not used."""

    GARBAGE = "garbage bytes"
    BAD_CRC = "bad crc"
    BAD_SIGNATURE = "bad signature"
    TRUNCATED = "truncated"
    UNKNOWN_MESSAGE = "unknown message"
    OTHER_SYSTEM = "other system or component"
    NON_FINITE = "non-finite"
    OUT_OF_RANGE = "out of range"
    NO_TIME = "no time"
    TIME_REVERSED = "time reversed"
    DUPLICATE = "duplicate"
    LATE = "late"
    OVERFLOW = "buffer full"
    UNSIGNED = "not signed"
    REPLAYED = "replayed"
    OLD_SIGNATURE = "signed more than a minute ago"
    NOT_ALLOWED = "sender not allowed"
    OWN_ECHO = "own echo"
    SPARE_LINK = "heard on another link too"
    SECRET = "carries a secret"


class Phase(StrEnum):
    """Flight phase; sensors are judged in FLYING only."""

    UNKNOWN = "unknown"
    GROUND = "ground"
    TAKEOFF = "take-off"
    FLYING = "flying"
    LANDING = "landing"


GYRO_ACC_AXES = ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
"""Axes of an IMU in the order of every mask, state vector and published array."""
