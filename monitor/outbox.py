"""What leaves: messages to frames, numbered and signed for each link that they go out on.

Messages wait here for the end of a turn of the loop and no longer. Only what the publisher and the
component's services say is ever sent: what came in on a link is never passed on.

Frames are numbered per link, so that one who hears a single link sees no gap where another link was
answered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

from links.mavlink import Encoder
from monitor.publish import Message

__all__ = ["WAITING_MAX", "Outbox"]

WAITING_MAX = 1024
"""Messages that wait for the end of a turn; of more, the oldest are dropped and counted."""

Address = tuple[int, int]


class Outbox:
    """Encodes, signs and sends.

    Parameters
    ----------
    send
        Sends a frame on the link of a number; never waits.
    outputs
        Numbers of the links that a message without a link of its own goes out on.
    address
        System and component id to send as; None while nothing may be sent.
    sign
        Frame and link number -> the frame as it goes out there.
    sent
        Told of every frame as it leaves.
    dialect
        Name of the dialect.

    Attributes
    ----------
    dropped
        Messages that too many others followed before they could be sent.
    unfit
        Messages that the dialect could not hold, and the newest reason.
    """

    def __init__(
        self,
        send: Callable[[bytes, int], object],
        outputs: Sequence[int],
        address: Callable[[], Address | None],
        sign: Callable[[bytes, int], bytes] = lambda frame, link: frame,
        sent: Callable[[bytes], object] = lambda frame: None,
        dialect: str = "ardupilotmega",
    ) -> None:
        self._send, self._sign, self._sent = send, sign, sent
        self._outputs = tuple(outputs)
        self._address = address
        self._dialect = dialect
        self._waiting: deque[Message] = deque(maxlen=WAITING_MAX)
        self._encoders: dict[tuple[Address, int], Encoder] = {}
        self.dropped = 0
        self.unfit: tuple[int, str] = (0, "")

    def put(self, messages: Iterable[Message]) -> None:
        """Have messages sent at the end of the turn, in this order."""
        for message in messages:
            if len(self._waiting) == WAITING_MAX:
                self.dropped += 1
            self._waiting.append(message)

    def flush(self) -> list[bytes]:
        """Send all that waits; of each message the frame that left first.

        While nothing may be sent yet what waits is dropped: it would be an answer too late.
        """
        waiting, self._waiting = self._waiting, deque(maxlen=WAITING_MAX)
        address = self._address()
        if address is None:
            return []
        out = []
        for message in waiting:
            links = self._outputs if message.link is None else (message.link,)
            try:
                frames = [(self._frame(message, address, link), link) for link in links]
            except ValueError as error:
                self.unfit = self.unfit[0] + 1, str(error)
                continue
            for frame, link in frames:
                self._send(frame, link)
                self._sent(frame)
            out += [frame for frame, _ in frames[:1]]
        return out

    def _frame(self, message: Message, address: Address, link: int) -> bytes:
        encoder = self._encoders.get((address, link))
        if encoder is None:
            encoder = self._encoders[address, link] = Encoder(*address, self._dialect)
        return self._sign(encoder.encode(message.name, **message.fields), link)
