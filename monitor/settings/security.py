"""Who is let in, and what is signed."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from links.mavlink.reception import allow_table
from monitor.settings.base import Section

__all__ = ["SecuritySettings"]


class SecuritySettings(Section):
    """Who is let in on the MAVLink links, and MAVLink 2 signing; docs/security.md tells more."""

    key_file: str = Field(
        "",
        description="File that holds the signing key, readable by its owner alone, who must be us: "
        "a passphrase (as Mission Planner and MAVProxy take it), 64 hexadecimal digits or 32 "
        "bytes. Empty: MAVSENTRY_SIGNING_KEY of the environment, else mavlink-key among systemd's "
        "credentials; without any of them there is no signing.",
    )
    accept_unsigned: bool = Field(
        False,
        description="With a key: packets without a signature are let in as well. A wrong signature "
        "is refused in any case. False: they change nothing.",
    )
    unsigned_links: tuple[str, ...] = Field(
        (),
        description="Links, written as under --in or --out, on which packets without a signature "
        "are let in in any case: a cable to the autopilot, which many do not sign.",
    )
    sign: bool = Field(True, description="With a key: sign what we send.")
    allow: tuple[str, ...] = Field(
        (),
        description="Senders that are let in, each SYSTEM:COMPONENT with * for any, such as "
        '"1:*" or "255:190". Empty: all.',
    )

    @model_validator(mode="after")
    def _patterns(self) -> Self:
        allow_table(self.allow)
        return self
