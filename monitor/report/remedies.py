"""What it means that a sensor could not be judged or a sample was not used, and what to do."""

from __future__ import annotations

from typing import Final, NamedTuple

from links.vocabulary import Reason, Rejection, State

__all__ = ["NOT_FLOWN", "ORDINARY", "REJECTED", "Remedy", "remedy"]


class Remedy(NamedTuple):
    """What a reason means, and the one thing to do about it; empty where nothing is to be done."""

    meaning: str
    action: str = ""


ORDINARY: Final = frozenset({str(Reason.ON_GROUND), str(Reason.LEARNING)})
"""Reasons of every flight."""

_LEARN_AIRFRAME: Final = (
    "mavsentry learn airframe LOG... --start aerosonde --out mine.toml, from healthy flights of "
    "this aircraft; then name it under [wing] airframe"
)

_REASONS: Final[dict[str, Remedy]] = {
    Reason.ON_GROUND: Remedy("Sensors are judged in flight."),
    Reason.LEARNING: Remedy("What is normal on this flight was still being learnt."),
    Reason.WIND_NOT_OBSERVABLE: Remedy(
        "On a long straight leg a change of wind and an error of airspeed look alike.",
        "Fly a turn now and then: it tells them apart.",
    ),
    Reason.REFERENCE_MISSING: Remedy(
        "What the sensor is held against did not come.",
        "See that satellite velocity, attitude and static pressure are in the log, twice a second "
        "or more.",
    ),
    Reason.REFERENCE_NOT_TRUSTED: Remedy(
        "Satellite velocity, attitude or static pressure contradicted each other or another "
        "sensor.",
        "Look at what was faulty then; else at receiver, antenna, jamming and static port.",
    ),
    Reason.MANOEUVRE: Remedy(
        "It turned faster than the model holds for (imu.max_rate_rad_s); judging went on soon "
        "after."
    ),
    Reason.SENSORS_DISAGREE: Remedy(
        "One of them is wrong, and nothing on board could tell which.",
        "Compare them on the ground before the next flight.",
    ),
    Reason.NO_ENGINE_MODEL: Remedy(
        "Without a model of the engine only a dead or a stuck channel is found.",
        "mavsentry learn engine LOG... --out engine.toml, from healthy flights; then --config "
        "engine.toml",
    ),
    Reason.NO_AIRFRAME: Remedy(
        "Lost lift and added drag are seen against the aircraft's coefficients, and none are "
        "configured.",
        _LEARN_AIRFRAME,
    ),
    Reason.AIRFRAME_MISFIT: Remedy(
        "The aircraft does not fly as the configured coefficients say.", _LEARN_AIRFRAME
    ),
    Reason.MUTED: Remedy(
        "An operator muted it.",
        "When it is mended, unmute it: [mute] of the configuration, parameters MUTE_*.",
    ),
    State.STALE: Remedy(
        "Its data stopped.", "Look for the cause in wiring, driver, logging rates or radio link."
    ),
    State.ABSENT: Remedy(
        "Nothing but zeros, or the sign for not fitted, came from it.",
        "Nothing if it is not fitted; else look at its wiring and its driver's parameters.",
    ),
}

_OF_QUANTITY: Final[dict[tuple[str, str], Remedy]] = {
    (Reason.LEARNING, "airspeed"): Remedy(
        "Its scale was being learnt beside the wind: that takes the first turns."
    ),
    (Reason.LEARNING, "imu"): Remedy("The filters were being aligned."),
    (Reason.LEARNING, "engine"): Remedy(
        "How much power the throttle usually gives was being learnt."
    ),
    (Reason.LEARNING, "spool"): Remedy("How the speed follows the throttle was being learnt."),
    (Reason.LEARNING, "wing"): Remedy("Wind and residuals had to settle first."),
    (Reason.REFERENCE_MISSING, "airspeed"): Remedy(
        "Airspeed is held against satellite velocity and wind, and the velocity did not come.",
        "See that the receiver has a fix, and its velocity is in the log.",
    ),
    (Reason.REFERENCE_MISSING, "imu"): Remedy(
        "The filters need satellite velocity, static pressure and attitude.",
        "See that all three are in the log, and the receiver has a fix.",
    ),
    (Reason.REFERENCE_MISSING, "spool"): Remedy(
        "The throttle's output did not come.", "Log SERVO_OUTPUT_RAW (RCOU, actuator_outputs)."
    ),
    (Reason.REFERENCE_MISSING, "engine"): Remedy(
        "The throttle's output did not come.", "Log SERVO_OUTPUT_RAW (RCOU, actuator_outputs)."
    ),
    (Reason.REFERENCE_MISSING, "wing"): Remedy(
        "Wings are judged by velocity, attitude, airspeed and the surfaces, and one of them did "
        "not come.",
        "Log satellite velocity, attitude, airspeed and SERVO_OUTPUT_RAW.",
    ),
    (Reason.MANOEUVRE, "wing"): Remedy(
        "It flew slower than the model of the wings holds for (wing.least_airspeed_m_s)."
    ),
    (Reason.SENSORS_DISAGREE, "imu"): Remedy(
        "Two IMUs differed, and the references did not tell which is wrong.",
        "Compare them at rest on the ground; a third one would tell in flight.",
    ),
}
"""(reason, quantity): where it means something more definite."""

_UNKNOWN: Final = Remedy("")

REJECTED: Final[dict[str, str]] = {
    Rejection.GARBAGE: "Bytes that belong to no message: damage, or something else on the line.",
    Rejection.BAD_CRC: "The check sum is wrong: bits were changed on the way.",
    Rejection.BAD_SIGNATURE: "The message's signature does not hold: it may be forged.",
    Rejection.TRUNCATED: "A message that breaks off.",
    Rejection.UNKNOWN_MESSAGE: "A kind of message that the dialect does not know; no harm.",
    Rejection.OTHER_SYSTEM: "Sent by another aircraft, a ground station or a companion computer: "
    "only the autopilot's own data are used.",
    Rejection.NON_FINITE: "Not a number, or infinite.",
    Rejection.OUT_OF_RANGE: "A value that no such sensor can have, or a time that cannot be.",
    Rejection.NO_TIME: "Came before anything that tells the vehicle's time.",
    Rejection.TIME_REVERSED: "Stamped earlier than the one before it.",
    Rejection.DUPLICATE: "The same sample again: no new measurement.",
    Rejection.LATE: "Came after newer data had been judged already (streams.horizon_s).",
    Rejection.OVERFLOW: "More waited than there is room for.",
    Rejection.UNSIGNED: "Signed messages are demanded and this one is not: a device without the "
    "key, or an intruder.",
    Rejection.REPLAYED: "Signed, but no newer than the last of its sender: sent again by somebody, "
    "overtaken on the way, or the same packet over a second path.",
    Rejection.OLD_SIGNATURE: "The first of a sender, signed more than a minute before our time: a "
    "recording, or a device whose clock is behind.",
    Rejection.NOT_ALLOWED: "From a system or component that security.allow does not list.",
    Rejection.OWN_ECHO: "What we sent ourselves came back, or another sender uses our ids.",
    Rejection.SPARE_LINK: "The sender is heard on several links and one speaks for it; no harm.",
    Rejection.SECRET: "Carries a key (SETUP_SIGNING): never used, passed on or kept.",
}
"""Reason of a rejection -> what it means."""


NOT_FLOWN: Final = Remedy(
    "The aircraft was not seen to fly, and sensors are judged in flight.",
    "If it did fly, see that satellite velocity or airspeed is in the log: they tell.",
)
"""Of a sensor that was taken to stand on the ground all the time."""


def remedy(reason: str, sensor: str) -> Remedy:
    """What a reason means for a sensor; empty for a reason that is not known."""
    quantity = sensor.partition(".")[0].partition("_")[0].rstrip("0123456789")
    return _OF_QUANTITY.get((reason, quantity)) or _REASONS.get(reason, _UNKNOWN)
