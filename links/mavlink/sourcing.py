"""Which messages give which sensors: the catalogue as a dialect and the options use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links import catalog
from links.catalog import Source
from links.mavlink.dialect import Dialect
from links.mavlink.options import DecoderOptions
from links.samples import Rows
from links.spool_sources import spool_source

__all__ = ["Entry", "source_table"]


@dataclass(frozen=True, slots=True)
class Entry:
    """A source in use: its rank, its place among the rows of one frame, whom it is taken from.

    Attributes
    ----------
    rank
        Place among the sources of its quantity, 0 the best.
    order
        Breaks ties between rows of one frame.
    source
        The catalogue's line.
    components
        Component ids that it is taken from; None for any but our own.
    named
        Name that a NAMED_VALUE_FLOAT must have.
    """

    rank: int
    order: int
    source: Source
    components: tuple[int, ...] | None
    named: bytes | None

    def theirs(
        self, payload: Rows, component: NDArray[np.int64] | None
    ) -> NDArray[np.bool_] | None:
        """Which payloads are this source's; None for all.

        Parameters
        ----------
        payload : (n,) structured
            Payloads of the source's message.
        component : (n,) int64
            Who sent each; None when all are the autopilot's.
        """
        source, conditions = self.source, []
        if component is not None and self.components is not None:
            conditions.append(np.isin(component, self.components))
        if self.named is not None:
            conditions.append(payload["name"] == self.named)
        if source.only is not None:
            conditions.append(source.only(payload))
        if not conditions:
            return None
        mask: NDArray[np.bool_] = np.logical_and.reduce(conditions)
        return None if mask.all() else mask


def source_table(
    dialect: Dialect, options: DecoderOptions, autopilot: int | None
) -> dict[int, list[Entry]]:
    """Message number -> the sources that it carries.

    Parameters
    ----------
    autopilot
        MAV_AUTOPILOT of the vehicle, None before it is known.

    Raises
    ------
    ValueError
        When a ranking names no known quantity, or a channel no known part of a message.
    """
    ranking = dict(catalog.RANKING)
    ranking.update(catalog.RANKING_BY_AUTOPILOT.get(-1 if autopilot is None else autopilot, {}))
    if strange := set(options.ranking) - set(ranking):
        raise ValueError(f"no quantity is called {', '.join(sorted(map(repr, strange)))}")
    named = [
        catalog.named_source(name, sensor, into, scale)
        for name, (sensor, into, scale) in options.named_inputs.items()
    ]
    chosen = [spool_source(sensor, *part) for sensor, part in options.spools.items()]
    given = [s for s in (*catalog.SOURCES, *named) if not (chosen and s.quantity == "spool")]
    ranking = options.ranked(ranking, (*catalog.SOURCES, *named, *chosen))
    table: dict[int, list[Entry]] = {}
    for order, source in enumerate((*given, *chosen)):
        message = dialect.by_name.get(source.message)
        keys = ranking[source.quantity]
        if message is None or source.key not in keys:
            continue
        entry = Entry(
            keys.index(source.key),
            order,
            source,
            _components(source, options),
            None if source.named is None else source.named.encode(),
        )
        table.setdefault(message.id, []).append(entry)
    return table


def _components(source: Source, options: DecoderOptions) -> tuple[int, ...] | None:
    """Components that a source is taken from; texts and named values come from anyone."""
    if source.message in options.components:
        return tuple(options.components[source.message])
    if source.quantity in catalog.FROM_ANY_COMPONENT:
        return None
    return (options.autopilot_component,)
