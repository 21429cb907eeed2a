"""A message that was heard on a link and accepted: by name, decoded, with who sent it and where.

What the component's services get. Samples never take this way: the decoder reads their bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

__all__ = ["Heard"]


class Heard(NamedTuple):
    """One accepted message.

    Attributes
    ----------
    name
        MAVLink message name.
    system, component
        Who sent it.
    link
        Number of the link that it came in on.
    fields
        Every field by its MAVLink name; text without its padding, arrays as lists.
    host_us
        When it arrived, host monotonic [us].
    signed
        Its signature was checked and is right.
    frame
        The frame as it came: tells an echo of what we sent from another sender with our ids.
    """

    name: str
    system: int
    component: int
    link: int
    fields: Mapping[str, Any]
    host_us: int
    signed: bool = False
    frame: bytes = b""
