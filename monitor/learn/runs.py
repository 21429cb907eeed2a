"""Many flights through the pipeline, on the engine that judges fleets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from links.logs import LogError
from monitor.fleet.engine import Engine
from monitor.fleet.sources import Source, expand, opened
from monitor.learn.flights import Flight, measure_log
from monitor.settings import Settings

__all__ = ["WORTH_BYTES", "Flown", "logs_of", "measure_logs"]

WORTH_BYTES = 48_000_000
"""Less than this is done before other processes have started and loaded their kernels."""


@dataclass(frozen=True, slots=True)
class Flown:
    """One log and the settings that it is run with."""

    number: int
    source: Source
    settings: Settings


def logs_of(patterns: Iterable[str]) -> list[Source]:
    """The logs that the patterns name, each once, in the order of the patterns.

    Raises
    ------
    monitor.fleet.sources.SourceError
        A pattern names nothing, or its file system cannot be reached.
    """
    found = {s.log: s for pattern in patterns for s in expand([pattern])}
    return list(found.values())


def measure_logs(
    engine: Engine,
    logs: Sequence[tuple[Source, Settings]],
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Flight]:
    """Measure logs, each with its settings, in the order given.

    Parameters
    ----------
    engine
        Whose workers do it.
    progress
        Called with the fraction done.

    Raises
    ------
    links.logs.LogError
        One of the files cannot be read as a log.
    OSError
        One of the files cannot be read.
    monitor.fleet.engine.EngineError
        The workers are gone.
    """
    total, done = max(sum(source.bytes for source, _ in logs), 1), 0
    flights: dict[int, Flight] = {}
    items = [Flown(k, source, settings) for k, (source, settings) in enumerate(logs)]
    for ended in engine.run(measure_one, items):
        if ended.result is None:
            raise ended.error or LogError(f"{ended.item.source.log}: no result")
        flights[ended.item.number] = ended.result
        done += ended.item.source.bytes
        progress(done / total)
    return [flights[k] for k in range(len(logs))]


def measure_one(flown: Flown) -> Flight:
    """One log, on whichever worker takes it."""
    with opened(flown.source) as (path, _):
        try:
            return measure_log(path, flown.settings)
        except LogError as error:
            raise LogError(str(error).replace(str(path), flown.source.log)) from None
