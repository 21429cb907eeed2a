"""Keeps the state every few seconds and at the end, and takes it up at the start.

The loop is asked for a snapshot, which takes it some milliseconds; packing it, writing it and
waiting for the disk is a thread's work. A snapshot that still waits for a slow disk is replaced by
the next.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from monitor.checkpoint import file
from monitor.checkpoint.file import Unusable
from monitor.checkpoint.graph import Unstorable
from monitor.checkpoint.identity import code_digest
from monitor.checkpoint.snapshot import OTHER_VEHICLE, Resumable, Snapshot, load, take
from monitor.settings import Settings

if TYPE_CHECKING:
    from links.mavlink import Decoder
    from monitor.pipeline import Pipeline
    from monitor.publish import Publisher

__all__ = ["Checkpointer"]

_LAST_S = 0.7
"""Longest wait for the disk at the end: the whole stop must be done within a second."""


class Checkpointer:
    """The checkpoints of one daemon.

    ``resume`` once, before the first bytes are decoded; then ``turn`` between any two turns of the
    loop; ``close`` when it has stopped turning and before what waits is flushed: the state at the
    end of a stream is not that of a gap in it.

    Parameters
    ----------
    folder
        Where files are kept, one of each vehicle; made if it is not there. None keeps nothing: what
        a log teaches is not what the vehicle does now.
    settings
        Ours; ``checkpoint.interval_s`` of 0 keeps nothing.
    decoder, pipeline, publisher
        Freshly built.
    say
        Told in one sentence what an operator should know: what was taken up or why not, and, once,
        that nothing can be kept.

    Attributes
    ----------
    resumed
        Whether a checkpoint was taken up.
    """

    def __init__(
        self,
        folder: Path | None,
        settings: Settings,
        decoder: Decoder,
        pipeline: Pipeline,
        publisher: Publisher,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.resumed = False
        self._max_age_s = settings.checkpoint.max_age_s
        self._component = settings.links.component_id
        self._folder = folder or Path()
        self._decoder = decoder
        self._stages = decoder, pipeline, publisher
        self._say = say
        self._interval_us = round(settings.checkpoint.interval_s * 1e6) if folder else 0
        self._next_us: int | None = None
        self._rows = 0
        self._found: dict[Path, Resumable] = {}
        self._told: str | None = None
        self._writer = _Writer()
        code_digest()  # reads every source: now, not in the loop

    def resume(self) -> None:
        """Read what is there; it is taken up when its vehicle is heard."""
        if not self._interval_us:
            return
        mine = f"checkpoint-*-{self._component}"
        for path in sorted(self._folder.glob(mine)) if self._folder.is_dir() else ():
            try:
                self._found[path] = load(path, *self._stages, self._max_age_s)
            except FileNotFoundError:
                continue
            except Unusable as error:
                self._say(f"checkpoint not used: {error}")
        if self._found:
            self._decoder.on_vehicle = self._take_up

    def turn(self, now_us: int) -> None:
        """Keep the state if it is time to; host monotonic time [us]."""
        if not self._interval_us:
            return
        if self._writer.problem != self._told:
            self._told = self._writer.problem
            if self._told is not None:
                self._say(self._told)
        if self._next_us is None:
            self._next_us = now_us + self._interval_us
        elif now_us >= self._next_us:
            self._next_us = now_us + self._interval_us
            self._offer()

    def close(self) -> None:
        """Keep the state as it is, and wait for the disk, not for long."""
        if self._interval_us:
            self._offer()
        self._writer.close(_LAST_S)

    def _offer(self) -> None:
        """Hand over the state, unless nothing has come since the last time."""
        snapshot = self._take()
        if snapshot is not None:
            self._rows = snapshot.rows
            self._writer.offer(self._path(), snapshot)

    def _take(self) -> Snapshot | None:
        if self._decoder.rows == self._rows:
            return None
        try:
            return take(*self._stages)
        except Unstorable as error:
            self._interval_us = 0
            self._say(f"no checkpoints are kept: {error}")
            return None

    def _path(self) -> Path:
        vehicle = self._decoder.vehicle
        assert vehicle is not None
        return self._folder / f"checkpoint-{vehicle.system_id}-{self._component}"

    def _take_up(self) -> None:
        """The vehicle is known and nothing was decoded yet."""
        found = self._found.pop(self._path(), None)
        self._found.clear()
        try:
            if found is None:
                raise Unusable(OTHER_VEHICLE)
            age_s = found.take_up(*self._stages, self._max_age_s)
        except Unusable as error:
            self._say(f"checkpoint not used: {error}")
            return
        self.resumed = True
        faulty = f"; faulty: {', '.join(found.faulty)}" if found.faulty else ""
        self._say(f"taken up from {age_s:.1f} s ago{faulty}")


class _Writer:
    """A thread that puts the newest snapshot on the disk.

    Attributes
    ----------
    problem
        Why the last one could not be written; None when it was.
    """

    def __init__(self) -> None:
        self.problem: str | None = None
        self._waiting: tuple[Path, Snapshot] | None = None
        self._changed = threading.Condition()
        self._over = False
        self._thread: threading.Thread | None = None

    def offer(self, path: Path, snapshot: Snapshot) -> None:
        """Write this instead of what still waits."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="checkpoint", daemon=True)
            self._thread.start()
        with self._changed:
            self._waiting = path, snapshot
            self._changed.notify()

    def close(self, timeout_s: float) -> None:
        """Write what waits and end; a disk that hangs is left behind."""
        with self._changed:
            self._over = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._waiting is None and not self._over:
                    self._changed.wait()
                task, self._waiting = self._waiting, None
            if task is None:
                return
            try:
                file.replace(task[0], task[1].pack())
                self.problem = None
            except OSError as error:
                self.problem = f"checkpoint cannot be kept: {error.strerror or error}"
