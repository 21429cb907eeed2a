"""Messages to bytes: any message of the dialect, by name and fields.

Layouts come precompiled from the dialect's tables, so that a simulated autopilot with four IMUs at
200 Hz is encoded far faster than it flies. What the monitor itself sends is in
:data:`OUTPUT_MESSAGES`; what stands in those messages, and when, is the publisher's business.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from fastcrc.crc16 import mcrf4xx

from links.mavlink.dialect import Dialect, Message, load_dialect

__all__ = ["OUTPUT_MESSAGES", "Encoder", "encode"]

OUTPUT_MESSAGES = (
    "HEARTBEAT",
    "STATUSTEXT",
    "NAMED_VALUE_FLOAT",
    "AIRSPEED",
    "AOA_SSA",
    "WIND_COV",
    "HIGHRES_IMU",
    "SCALED_IMU",
    "SCALED_IMU2",
    "SCALED_IMU3",
    "DEBUG_FLOAT_ARRAY",
)
"""Messages that the monitor publishes, where the dialect has them."""

_HEAD_V2 = struct.Struct("<BBBBBBHB")  # what the checksum covers: all but the first byte
_HEAD_V1 = struct.Struct("<BBBBB")
_CRC = struct.Struct("<H")
_BYTES = tuple(bytes([k]) for k in range(256))


class _Layout:
    """Where each field of a message goes among the values of its ``struct``."""

    __slots__ = ("blank", "message", "places")

    def __init__(self, message: Message) -> None:
        self.message = message
        self.blank: list[Any] = []
        self.places: dict[str, tuple[int, int, int]] = {}  # first value, values, string size
        for name, count in zip(message.wire_fields, message.wire_counts, strict=True):
            kind = message.dtype[name]
            text = kind.itemsize if kind.kind == "S" else 0
            self.places[name] = len(self.blank), count, text
            self.blank += [b""] if text else [0] * count

    def payload(self, fields: dict[str, Any]) -> bytes:
        values = self.blank.copy()
        for name, value in fields.items():
            try:
                at, count, text = self.places[name]
            except KeyError:
                raise ValueError(f"{self.message.name} has no field {name!r}") from None
            if text:
                encoded = value.encode("ascii", "replace") if isinstance(value, str) else value
                values[at] = encoded[:text]
            elif count == 1:
                values[at] = value
            elif len(value) > count:
                raise ValueError(f"{self.message.name}.{name} holds {count} values")
            else:
                values[at : at + len(value)] = value
        try:
            return self.message.packer.pack(*values)
        except (struct.error, OverflowError, TypeError) as error:
            raise ValueError(f"{self.message.name} cannot hold these values: {error}") from None


@lru_cache(maxsize=1024)
def _layout(dialect: str, message: str) -> _Layout:
    try:
        return _Layout(load_dialect(dialect).by_name[message])
    except KeyError:
        raise ValueError(f"the MAVLink dialect {dialect} has no message {message!r}") from None


class Encoder:
    """Encodes one component's messages, numbering them.

    Parameters
    ----------
    system_id, component_id
        Who sends.
    dialect
        Name of the dialect.
    version
        MAVLink 2, or 1 (without the extension fields and for message numbers below 256).

    Attributes
    ----------
    messages, bytes
        Encoded so far.
    by_name
        Message name -> encoded so far.

    Raises
    ------
    ValueError
        For an unknown dialect, an id outside 1 to 255, or another version.
    """

    def __init__(
        self,
        system_id: int,
        component_id: int,
        dialect: str = "ardupilotmega",
        *,
        version: int = 2,
    ) -> None:
        if not (1 <= system_id <= 255 and 1 <= component_id <= 255):
            raise ValueError(f"MAVLink ids are 1 to 255, not {system_id} and {component_id}")
        if version not in (1, 2):
            raise ValueError(f"MAVLink has versions 1 and 2, not {version}")
        self._dialect: Dialect = load_dialect(dialect)
        self._system, self._component, self._version = system_id, component_id, version
        self._layouts: dict[str, _Layout] = {}
        self._sequence = 0
        self.messages = 0
        self.bytes = 0
        self.by_name: Counter[str] = Counter()

    def has(self, message: str) -> bool:
        """Whether the dialect has a message of this name."""
        return message in self._dialect.by_name

    def encode(self, message: str, /, **fields: Any) -> bytes:
        """One frame; fields that are not given are zero.

        Parameters
        ----------
        message
            MAVLink message name, ``"NAMED_VALUE_FLOAT"``.
        fields
            By their MAVLink names, in MAVLink's units; text is cut to the field's size.

        Raises
        ------
        ValueError
            For an unknown message or field, or a value that the field cannot hold.
        """
        layout = self._layouts.get(message)
        if layout is None:
            layout = self._layouts[message] = _layout(self._dialect.name, message)
        return self._frame(layout.message, layout.payload(fields))

    def packer(self, message: str, /) -> Callable[..., bytes]:
        """Fast form of :meth:`encode`: a function of all values in wire order.

        ``links.mavlink.dialect`` tells the order (``Message.wire_fields``); arrays are spread out.
        """
        found = _layout(self._dialect.name, message).message
        pack, frame = found.packer.pack, self._frame
        return lambda *values: frame(found, pack(*values))

    def _frame(self, message: Message, payload: bytes) -> bytes:
        number, sequence = message.id, self._sequence
        self._sequence = (sequence + 1) & 0xFF
        if self._version == 2:
            # trailing zeros are not sent, but for the first byte
            payload = payload.rstrip(b"\0") or b"\0"
            low, high = number & 0xFFFF, number >> 16
            body = (
                _HEAD_V2.pack(
                    len(payload), 0, 0, sequence, self._system, self._component, low, high
                )
                + payload
            )
            magic = b"\xfd"
        else:
            if number > 0xFF:
                raise ValueError(f"MAVLink 1 cannot carry {message.name}")
            payload = payload[: message.base_size]
            body = (
                _HEAD_V1.pack(len(payload), sequence, self._system, self._component, number)
                + payload
            )
            magic = b"\xfe"
        crc = mcrf4xx(body + _BYTES[message.crc_extra])
        self.messages += 1
        self.bytes += len(body) + 3
        self.by_name[message.name] += 1
        return magic + body + _CRC.pack(crc)


def encode(message: str, /, **fields: Any) -> bytes:
    """One MAVLink 2 frame of system 1, component 1, numbered 0; streams need :class:`Encoder`."""
    return Encoder(1, 1).encode(message, **fields)
