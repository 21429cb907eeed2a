"""The live page: how often, how long, for how many, and who may see it."""

from pydantic import Field

from monitor.settings.base import Section

__all__ = ["WebSettings"]


class WebSettings(Section):
    """What ``run`` serves for browsers and Prometheus."""

    address: str = Field(
        "",
        description="Serve the live page and metrics there (run --web), such as 127.0.0.1:8080; "
        "empty serves none.",
    )

    rate_hz: float = Field(
        5.0, ge=1.0, le=10.0, description="Snapshots of the daemon sent to the live page."
    )
    history_s: float = Field(
        300.0,
        ge=10.0,
        le=1800.0,
        description="How far back a page that is opened shows; the web process keeps some 2 kB a "
        "snapshot.",
    )
    viewers: int = Field(
        16, ge=1, le=256, description="Pages that may be open at a time; more are refused, count."
    )
    behind_s: float = Field(
        10.0,
        ge=1.0,
        le=60.0,
        description="Snapshots that wait for one slow page; older ones are dropped for it.",
    )
    token_file: str = Field(
        "",
        description="File that holds the token which a page must present, readable by its owner "
        "alone. Empty: MAVSENTRY_WEB_TOKEN of the environment; without it no token on a loopback "
        "address, and on any other one that is made once and kept in the user's state folder.",
    )
    hosts: tuple[str, ...] = Field(
        (),
        description="Names by which browsers may ask for the page, beside localhost, this "
        "computer's own name and any address in numbers: what a reverse proxy is called.",
    )
