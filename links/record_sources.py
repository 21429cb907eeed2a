"""What a line of the table of a format with records of its own is: DataFlash, ULog.

As :class:`links.catalog.Source`, and what such formats spread over several messages.
"""

from __future__ import annotations

from dataclasses import dataclass

from links.catalog import Fill, Source

__all__ = ["Joined", "Leader", "RecordSource"]


@dataclass(frozen=True, slots=True)
class Leader:
    """The instance that another message names: the estimator in use, the selected sensor.

    Attributes
    ----------
    message, field
        Where its number stands; instance 0 until it is told.
    """

    message: str
    field: str


@dataclass(frozen=True, slots=True)
class Joined:
    """A field of a row that another message carries: its newest record before the row's counts.

    Attributes
    ----------
    message
        The other message.
    fill
        The field, as :class:`~links.catalog.Fill` has it. Until the message came a field that is
        required leaves the row out, uncounted; another is NaN, or 0 where it is a whole number.
    instance
        Column of the other message with its instance; None where it has only one, or where
        :attr:`links.logs.records.Records.instance` tells.
    leader
        Whose number picks the instance; None takes that of the row's own sensor.
    add
        Added to what the field holds already, instead of put in its place.
    """

    message: str
    fill: Fill
    instance: str | None = None
    leader: Leader | None = None
    add: bool = False


@dataclass(frozen=True, slots=True)
class RecordSource(Source):
    """A line of a format's table.

    Attributes
    ----------
    needs
        Columns that its functions read, besides those of ``fills``.
    joined
        What comes from other messages.
    number
        The ``Records.instance`` that it is taken from; None for any.
    """

    needs: tuple[str, ...] = ()
    joined: tuple[Joined, ...] = ()
    number: int | None = None

    @property
    def columns(self) -> frozenset[str]:
        """Columns without which the source cannot be used."""
        return frozenset(self.needs).union(*(fill.fields for fill in self.fills))
