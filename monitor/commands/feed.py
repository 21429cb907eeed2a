"""``mavsentry feed``: a synthetic aircraft that speaks MAVLink and whose sensors break."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands import completing
from monitor.commands.common import Refused, note, open_link, progress
from monitor.commands.replay import MAX_FRAMES_PER_S, speed_of

if TYPE_CHECKING:
    from links.endpoints import Endpoint
    from sim_feeds.scenario import Flight

__all__ = ["feed", "fly", "send", "write_log"]

Frame = tuple[int, bytes]


def feed(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="Bundled scenario or a TOML file.",
            autocompletion=completing.scenarios,
        ),
    ] = "demo",
    aircraft: Annotated[
        str | None,
        typer.Option(
            help="Not the scenario's: transport, light-aircraft, small-uav; or with the extra sim "
            "aerosonde, c172p, A320 and others of JSBSim, which fly a circuit instead of the legs.",
            metavar="NAME",
            autocompletion=completing.profiles,
        ),
    ] = None,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="LINK",
            help="Where the frames go; FILE.tlog writes a log.",
            autocompletion=completing.links,
        ),
    ] = "udpout:127.0.0.1:14550",
    speed: Annotated[
        str,
        typer.Option(
            metavar="FACTOR|max", help="1 is real time; a file is always written at once."
        ),
    ] = "1",
    seed: Annotated[int | None, typer.Option(help="Not the scenario's.", metavar="N")] = None,
    streams: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            min=0.1,
            help="Answer as an autopilot does: send each message at most so often at first, and "
            "more of what is asked for (SET_MESSAGE_INTERVAL).",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write truth.json and truth.npz to this folder."),
    ] = None,
) -> None:
    """Fly a synthetic aircraft and send what its autopilot would send."""
    flight = fly(scenario, aircraft, seed)
    to_file = to.endswith(".tlog")
    factor = speed_of(speed)
    if truth is not None:
        from sim_feeds.player import save_truth

        try:
            save_truth(flight, truth)
        except OSError as error:
            raise Refused(f"cannot write to {truth}: {error.strerror}") from None
    if to_file and streams is not None:
        raise Refused("a file asks for nothing: --streams is for links")
    if to_file:
        count = write_log(flight, Path(to))
    else:
        with open_link(to) as link:
            if streams is None:
                count = send(flight, link.send, factor)
            else:
                count = _converse(flight, link, factor, streams)
    note(f"mavsentry: sent {count} frames of {flight.truth.t_s[-1]:.0f} s of flight")


def fly(scenario: str, aircraft: str | None = None, seed: int | None = None) -> Flight:
    """The scenario flown.

    Raises
    ------
    Refused
        There is no such scenario, a value in it does not fit, or its aircraft needs JSBSim.
    """
    from sim_feeds.scenario import ScenarioError, load, with_aircraft

    def override(table: dict[str, Any]) -> None:
        if aircraft is not None:
            with_aircraft(table, aircraft)

    try:
        return load(scenario, override).fly(seed)
    except ScenarioError as error:
        raise Refused(str(error).replace("\n", "; ")) from None


def write_log(flight: Flight, file: Path) -> int:
    """Write the flight's frames as a telemetry log; return their number.

    Raises
    ------
    Refused
        The file cannot be written.
    """
    from links.logs import TlogWriter
    from sim_feeds.player import frames_of, unix_us

    count = 0
    try:
        with TlogWriter(file) as writer:
            for t_us, frame in frames_of(flight):
                writer.write(frame, unix_us(flight, t_us))
                count += 1
    except OSError as error:
        raise Refused(f"cannot write {file}: {error.strerror}") from None
    return count


def send(flight: Flight, out: Callable[[bytes], object], speed: float | None) -> int:
    """Send the frames at ``speed`` times real time; None paces what a receiver can keep up with."""
    from sim_feeds.player import frames_of, play

    with progress("flying") as tell:
        frames = _told(frames_of(flight), float(flight.truth.t_s[-1]), tell)
        if speed is not None:
            return play(frames, out, speed)
        paced = ((round(k * 1e6 / MAX_FRAMES_PER_S), data) for k, (_, data) in enumerate(frames))
        return play(paced, out, 1.0)


def _converse(flight: Flight, link: Endpoint, speed: float | None, hz: float) -> int:
    """Send the frames that it is the turn of, answer what comes back; return how many went out."""
    from sim_feeds.answering import AnsweringAutopilot
    from sim_feeds.player import frames_of, play

    pilot = AnsweringAutopilot(flight.scenario.messages.system_id, hz)
    t_us = count = 0

    def frames() -> Iterator[Frame]:
        nonlocal t_us
        for at_us, frame in frames_of(flight):
            t_us = at_us
            yield at_us, frame

    def out(frame: bytes) -> None:
        nonlocal count
        due = pilot.send(t_us, frame)
        answers = [a for data, _ in link.recv(0.0) for a in pilot.hear(data, t_us)]
        for data in (*answers, *([due] if due is not None else [])):
            link.send(data)
            count += 1

    with progress("flying") as tell:
        play(_told(frames(), float(flight.truth.t_s[-1]), tell), out, speed)
    return count


def _told(
    frames: Iterable[Frame], duration_s: float, tell: Callable[[float], None]
) -> Iterator[Frame]:
    """The frames, with progress told once per second of flight."""
    first_us = told_s = 0
    for k, (t_us, data) in enumerate(frames):
        first_us = t_us if k == 0 else first_us
        flown_s = (t_us - first_us) // 1_000_000
        if flown_s > told_s:
            told_s = flown_s
            tell(flown_s / duration_s)
        yield t_us, data
