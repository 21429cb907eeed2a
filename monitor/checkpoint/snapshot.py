"""What is kept of a running monitor, and what must be true of who takes it up.

Kept are the pipeline, what the publisher has said, and the decoder's memory (the vehicle's clock,
numbers and sources of the rows, pitot ratios); not the bytes of a message that was half there.

A snapshot is taken up only

- by the same code: its digest is compared, since the state has no other description than the code;
- with the same settings; where they differ, the pipeline is restored with those that it was made
  with and retuned to ours, which takes those thresholds that can be changed in flight;
- of the same vehicle: system id, autopilot and type;
- within ``checkpoint.max_age_s``. The vehicle's clock decides: the first stamp that is heard, less
  the newest before. Where it is behind, the vehicle has booted since, and all is learnt anew:
  whatever was known may be of another flight. The host's clocks decide before, as far as they can
  be believed (:func:`monitor.checkpoint.identity.age_s`): a vehicle that was switched off and on
  can reach the time of an old checkpoint again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from links.clock import BACK_US, VehicleClock
from links.mavlink.options import DecoderMemory, Vehicle
from links.vocabulary import State
from monitor.checkpoint import file, graph
from monitor.checkpoint.file import Unusable
from monitor.checkpoint.identity import Moment, age_s, code_digest, reading, shaping
from monitor.settings import Settings

if TYPE_CHECKING:
    from links.mavlink import Decoder
    from monitor.pipeline import Pipeline
    from monitor.publish import Publisher

__all__ = ["OTHER_VEHICLE", "Resumable", "Snapshot", "load", "take"]

_ALSO = (DecoderMemory, Vehicle)
"""Classes that a running monitor holds and a freshly built one does not know of."""


OTHER_VEHICLE = "it is of another vehicle"
_OTHER_CODE = "another version made it"
_NAMED = 3
"""Keys that are named where settings differ; the others are counted."""


class Snapshot(NamedTuple):
    """A monitor's state between two turns, as data; nothing that goes on changes it."""

    about: dict[str, Any]
    flat: graph.Flat

    @property
    def rows(self) -> int:
        """Rows that the monitor had seen."""
        return int(self.about["rows"])

    def pack(self) -> bytes:
        """The bytes of its file."""
        return file.pack(self.about, self.flat)


class _State(NamedTuple):
    """What is written down."""

    decoder: DecoderMemory | None
    pipeline: Pipeline
    publisher: Publisher


def take(decoder: Decoder, pipeline: Pipeline, publisher: Publisher) -> Snapshot | None:
    """The monitor's state now; None before a vehicle is heard.

    Raises
    ------
    monitor.checkpoint.graph.Unstorable
        Something in it is no data.
    """
    memory = decoder.memory()
    if memory is None:
        return None
    about = {
        "code": code_digest(),
        "settings": shaping(pipeline.settings),
        "reading": reading(decoder.options),
        "vehicle": asdict(memory.vehicle),
        "rows": int(memory.counts[0]),
        "taken": asdict(Moment.now()),
    }
    return Snapshot(about, graph.flatten(_State(memory, pipeline, publisher)))


@dataclass(frozen=True, slots=True)
class Resumable:
    """A snapshot that may be taken up once its vehicle is heard.

    Attributes
    ----------
    about
        What it says of itself.
    state
        The objects that it is of, made again.
    """

    about: dict[str, Any]
    state: Any

    @property
    def faulty(self) -> list[str]:
        """Sensors that stood faulty."""
        states = self.state.pipeline.states()
        return [sensor for sensor, v in states.items() if v.state is State.FAULTY]

    def take_up(
        self, decoder: Decoder, pipeline: Pipeline, publisher: Publisher, max_age_s: float
    ) -> float:
        """Let the three go on from it, before the decoder's first rows; return its age [s].

        Parameters
        ----------
        decoder
            It knows its vehicle and the vehicle's first stamp.
        pipeline, publisher
            They have seen nothing yet.

        Raises
        ------
        Unusable
            It must not be taken up; nothing has changed.
        """
        memory: DecoderMemory = self.state.decoder
        if decoder.vehicle != memory.vehicle:
            raise Unusable(OTHER_VEHICLE)
        clock = VehicleClock()
        clock.state = memory.clock
        first_us = decoder.first_t_us
        ahead_us = None if first_us is None else clock.ahead_us(first_us)
        if ahead_us is None or ahead_us < -BACK_US:
            raise Unusable("the vehicle has booted since")
        if ahead_us > max_age_s * 1e6:
            raise Unusable(_too_old(ahead_us / 1e6, max_age_s))
        try:
            decoder.recall(memory)
        except ValueError as error:
            raise Unusable(f"its decoder is {error}") from None
        for ours, kept in ((pipeline, self.state.pipeline), (publisher, self.state.publisher)):
            gone = type(ours).fleeting
            vars(ours).update({name: v for name, v in vars(kept).items() if name not in gone})
        pipeline.resume(int(clock.newest_us or 0) + ahead_us)
        return max(ahead_us / 1e6, 0.0)


def load(
    path: Path, decoder: Decoder, pipeline: Pipeline, publisher: Publisher, max_age_s: float
) -> Resumable:
    """Read a file and make its objects again.

    Parameters
    ----------
    path
        The file.
    decoder, pipeline, publisher
        Freshly built with our settings: what the objects are held against.
    max_age_s
        Age by the host's clocks up to which it may be taken up [s].

    Raises
    ------
    Unusable
        It cannot or must not be taken up; the sentence says why.
    FileNotFoundError
        There is none.
    """
    about, flat = file.unpack(file.read(path))
    try:
        code, taken, read = about["code"], Moment(**about["taken"]), about["reading"]
        theirs = Settings.model_validate(about["settings"])
    except (KeyError, TypeError, ValueError):
        raise Unusable(_OTHER_CODE) from None
    if code != code_digest():
        raise Unusable(_OTHER_CODE)
    host_s = age_s(taken, Moment.now())
    if host_s is not None and host_s > max_age_s:
        raise Unusable(_too_old(host_s, max_age_s))
    ours = reading(decoder.options)
    if read != ours:
        others = [f"links: {key}" for key in sorted(ours) if ours[key] != read.get(key)]
        raise Unusable(_other_settings(others))
    same = shaping(theirs) == shaping(pipeline.settings)
    fresh = _State(None, pipeline if same else type(pipeline)(theirs), publisher)
    try:
        state = graph.rebuild(flat, graph.classes_of(*_ALSO, fresh))
        graph.fit(fresh, state)
    except graph.Damaged as error:
        raise Unusable(f"it does not fit: {error}") from None
    if not same and (waiting := state.pipeline.retune(pipeline.settings).waiting):
        raise Unusable(_other_settings(waiting))
    return Resumable(about, state)


def _other_settings(keys: Sequence[str]) -> str:
    more = "" if len(keys) <= _NAMED else f" and {len(keys) - _NAMED} more"
    return f"it was made with other settings: {', '.join(keys[:_NAMED])}{more}"


def _too_old(age_s: float, max_age_s: float) -> str:
    shown = f"{age_s:.0f} s" if age_s < 600.0 else f"{age_s / 60.0:.0f} min"
    if age_s >= 7200.0:
        shown = f"{age_s / 3600.0:.0f} h"
    return f"it is {shown} old, {max_age_s:.0f} s are allowed"
