"""An autopilot that answers: it sends less than it could until somebody asks for more.

A flight's frames are fixed before it is played, so the intervals that a companion asks for thin
them out: a message comes as often as asked for, at most as often as the scenario has it. Answered
are GET_ and SET_MESSAGE_INTERVAL, as ArduPilot does, and TIMESYNC.
"""

from __future__ import annotations

from typing import Any, Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

from links.mavlink.dialect import load_dialect

__all__ = ["AnsweringAutopilot"]

ALWAYS: Final = ("HEARTBEAT", "STATUSTEXT", "PARAM_VALUE")
"""Messages that are no streams."""

STOPPED: Final = -1


class AnsweringAutopilot:
    """Thins a flight's frames, and answers who asks for other intervals.

    Parameters
    ----------
    system_id
        Of the vehicle.
    hz
        Most that each stream is sent at until another interval is asked for [1/s].

    Attributes
    ----------
    intervals_us
        Message number -> interval in force [us]; -1 stopped.
    """

    def __init__(self, system_id: int, hz: float) -> None:
        self._system = system_id
        self._first_us = round(1e6 / hz)
        self._table = load_dialect("ardupilotmega")
        self._always = {self._table.by_name[name].id for name in ALWAYS}
        self.intervals_us: dict[int, int] = {}
        self._next_us: dict[int, int] = {}
        self._packer = dialect.MAVLink(None, system_id, 1)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._sequence = 0

    def send(self, t_us: int, frame: bytes) -> bytes | None:
        """The frame as it goes out at this vehicle time [us], None if it is not its turn."""
        number = int.from_bytes(frame[7:10], "little")
        if number not in self._always:
            interval_us = self.intervals_us.setdefault(number, self._first_us)
            due_us = self._next_us.get(number, t_us)
            if interval_us == STOPPED or t_us < due_us:
                return None
            # half an interval late or more: begin anew instead of catching up
            self._next_us[number] = max(due_us + interval_us, t_us + interval_us // 2)
        return self._numbered(frame)

    def hear(self, data: bytes, t_us: int) -> list[bytes]:
        """Answers to what was received at this vehicle time."""
        out = []
        for message in self._parser.parse_buffer(data) or ():
            out += [
                self._numbered(bytes(m.pack(self._packer))) for m in self._answer(message, t_us)
            ]
        return out

    def _answer(self, message: Any, t_us: int) -> list[Any]:
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 == 0:
            return [dialect.MAVLink_timesync_message(t_us * 1000, message.ts1)]
        if kind != "COMMAND_LONG" or message.target_system != self._system:
            return []
        if message.target_component not in (0, 1):
            return []
        number = int(message.param1)
        out, result = [], dialect.MAV_RESULT_ACCEPTED
        if message.command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval_us = self.intervals_us.get(number, STOPPED)
            out.append(dialect.MAVLink_message_interval_message(number & 0xFFFF, interval_us))
        elif message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = dialect.MAV_RESULT_UNSUPPORTED
        elif number not in self._table.by_id or number in self._always:
            result = dialect.MAV_RESULT_FAILED
        else:
            self.intervals_us[number] = int(message.param2) or self._first_us
            self._next_us.pop(number, None)
        ack = dialect.MAVLink_command_ack_message(
            message.command,
            result,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
        return [*out, ack]

    def _numbered(self, frame: bytes) -> bytes:
        """The frame with the next sequence number: what is left out leaves no gap."""
        extra = self._table.by_id[int.from_bytes(frame[7:10], "little")].crc_extra
        body = frame[1:4] + bytes([self._sequence]) + frame[5:-2]
        self._sequence = (self._sequence + 1) & 0xFF
        crc = int(mcrf4xx(body + bytes([extra])))
        return frame[:1] + body + crc.to_bytes(2, "little")
