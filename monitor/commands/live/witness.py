"""Sees every turn of the loop and logs what happened in it.

Verdicts as they come; links, the vehicle, what is refused and what an operator must know are looked
at once a second, so that a link that flaps or a peer that floods cannot flood the log as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from links.vocabulary import Rejection, State
from monitor.commands.live.telling import Telling
from monitor.commands.showing import as_json, why
from monitor.service import Event, Notifier
from monitor.verdict import StepResult, Verdict

if TYPE_CHECKING:
    from monitor.commands.live.assembly import Running

__all__ = ["Witness", "health"]

LOOK_US: Final = 1_000_000
REFUSED_US: Final = 10_000_000
"""Refusals are summed up over this time."""

REPEAT_US: Final = 60_000_000
"""A note that comes and goes is told again after this time at the earliest."""

NOTES_KEPT: Final = 256

_GRAVE: Final = {State.FAULTY: "error", State.STOPPED: "error", State.STALE: "warning"}


class Witness:
    """Looks at a running daemon.

    Parameters
    ----------
    running
        The daemon and what goes with it.
    tell
        Takes events.
    notifier
        Told a sentence on how it goes.
    now_us
        Host monotonic time [us].
    """

    def __init__(
        self,
        running: Running,
        tell: Telling,
        notifier: Notifier,
        now_us: Callable[[], int],
    ) -> None:
        self._running, self._tell, self._notifier = running, tell, notifier
        self._now_us = now_us
        self._next_us = self._refused_us = now_us()
        self._open: list[bool | None] = [None] * len(running.links.hub.names)
        self._told: dict[str, int] = {}
        self._standing: frozenset[str] = frozenset()
        self._vehicle: object = None
        self._refused: list[Counter[Rejection]] = [Counter() for _ in self._open]

    def __call__(self, result: StepResult) -> None:
        """After each turn, with what it gave."""
        log = self._tell.log.log
        for verdict in result.verdicts:
            grave = _GRAVE.get(verdict.state, "info")
            log(Event.VERDICT, _sentence(verdict), grave, **as_json(verdict))
        now_us = self._now_us()
        if now_us < self._next_us:
            return
        self._next_us = now_us + LOOK_US
        self._see_vehicle()
        self._see_links()
        self._see_recorder()
        self._see_notes(now_us)
        if now_us >= self._refused_us:
            self._refused_us = now_us + REFUSED_US
            self._see_refused()
        if self._notifier.wants_status(now_us):
            self._notifier.status(health(self._running))

    def _see_vehicle(self) -> None:
        vehicle = self._running.decoder.vehicle
        if vehicle is not None and vehicle != self._vehicle:
            self._vehicle = vehicle
            facts: dict[str, Any] = {
                "system_id": vehicle.system_id,
                "autopilot": vehicle.autopilot,
                "type": vehicle.type,
            }
            self._tell.log.log(Event.VEHICLE, f"vehicle {vehicle.system_id} is watched", **facts)

    def _see_links(self) -> None:
        for number, state in enumerate(self._running.links.hub.states()):
            if state.open == self._open[number]:
                continue
            first, self._open[number] = self._open[number] is None, state.open
            facts: dict[str, Any] = {"link": number, "name": state.name, "kind": state.kind}
            if state.open:
                self._tell.log.log(Event.LINK_UP, f"{state.name} is open", **facts)
            elif not first or state.trouble:
                why_not = f": {state.trouble}" if state.trouble else ""
                self._tell.log.log(
                    Event.LINK_DOWN, f"{state.name} is not open{why_not}", "warning", **facts
                )

    def _see_recorder(self) -> None:
        recorder = self._running.recorder
        for sentence in recorder.news() if recorder is not None else ():
            grave = "warning" if recorder is not None and recorder.stopped else "info"
            self._tell(Event.RECORDER, sentence, grave)

    def _see_notes(self, now_us: int) -> None:
        """Tell what is new of what an operator must know."""
        trouble = self._tell.log.trouble
        recorder = self._running.recorder
        said = recorder.stopped if recorder is not None else None  # which has its own events
        notes = (*self._running.notes(), *((trouble,) if trouble else ()))
        for text in notes:
            if text == said:
                continue
            if text in self._standing or now_us - self._told.get(text, -REPEAT_US) < REPEAT_US:
                continue
            if len(self._told) >= NOTES_KEPT:
                del self._told[min(self._told, key=lambda known: self._told[known])]
            self._told[text] = now_us
            self._tell(Event.NOTE, text, "warning")
        self._standing = frozenset(notes)

    def _see_refused(self) -> None:
        """Sum up what was refused on each link since the last time."""
        for number, counts in enumerate(self._running.gate.reception.by_link):
            new = counts - self._refused[number]
            self._refused[number] = Counter(counts)
            if new:
                name = self._running.links.hub.names[number]
                said = ", ".join(f"{count} {reason}" for reason, count in new.most_common())
                counted = {str(reason): count for reason, count in new.items()}
                self._tell.log.log(
                    Event.REFUSED,
                    f"refused on {name}: {said}",
                    "debug" if set(new) <= _USUAL else "warning",
                    link=number,
                    name=name,
                    counts=counted,
                )


_USUAL: Final = frozenset({Rejection.OWN_ECHO, Rejection.SPARE_LINK})
"""Of a network in good order."""


def health(running: Running) -> str:
    """How it goes, in one sentence for ``systemctl status``."""
    vehicle = running.decoder.vehicle
    if vehicle is None:
        return f"no vehicle heard yet on {running.links.title}"
    status = running.daemon.status(recent=True)
    states = [verdict.state for verdict in running.pipeline.states().values()]
    ok = sum(state is State.OK for state in states)
    faulty = sorted(
        sensor for sensor, v in running.pipeline.states().items() if v.state is State.FAULTY
    )
    where = (
        "LINK SILENT" if status.silent else "flying" if running.pipeline.flying else "not flying"
    )
    broken = f"; FAULTY: {', '.join(faulty)}" if faulty else ""
    notes = f"; {len(running.notes())} notes" if running.notes() else ""
    return f"vehicle {vehicle.system_id} {where}; {ok} of {len(states)} sensors ok{broken}{notes}"


def _sentence(verdict: Verdict) -> str:
    reason = why(verdict)
    return f"{verdict.sensor} {verdict.state}" + (f": {reason}" if reason else "")
