"""What the shell offers behind an option or argument, looked up when the key is pressed.

Each takes what stands there already and gives words that begin with it, or nothing: then the shell
offers files. Nothing is loaded for the others: a key that is pressed wants an answer at once.
"""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["airframes", "links", "logs", "profiles", "scenarios", "setting_keys", "settings_files"]

LOGS = (".tlog", ".bin", ".ulg")
LINKS = (
    "udpin:0.0.0.0:14550",
    "udpout:127.0.0.1:14550",
    "tcp:127.0.0.1:5760",
    "tcpin:0.0.0.0:5760",
)
SERIAL = ("/dev/serial/by-id/*", "/dev/ttyACM*", "/dev/ttyUSB*", "/dev/ttyAMA*", "/dev/ttyTHS*")
CLASSES = ("small-uav", "light-aircraft", "transport")

_ROOT = Path(__file__).resolve().parents[2]


def _files(incomplete: str, suffixes: tuple[str, ...]) -> list[str]:
    """Files of these suffixes and folders, as typed so far; folders end with a slash."""
    typed, _, _ = incomplete.rpartition("/")
    folder = Path(os.path.expanduser(typed + "/" if "/" in incomplete else "."))
    head = incomplete[: len(typed) + 1] if "/" in incomplete else ""
    found = []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                name = head + entry.name
                if not name.startswith(incomplete) or entry.name.startswith("."):
                    continue
                if entry.is_dir():
                    found.append(f"{name}/")
                elif entry.name.lower().endswith(suffixes):
                    found.append(name)
    except OSError:
        return []
    return sorted(found)


def _bundled(incomplete: str, package: str, suffix: str = ".toml") -> list[str]:
    files = (_ROOT / package).glob(f"*{suffix}")
    return sorted(f.stem for f in files if f.stem.startswith(incomplete))


def logs(incomplete: str) -> list[str]:
    """Flight logs, and folders on the way to them."""
    return _files(incomplete, LOGS)


def settings_files(incomplete: str) -> list[str]:
    """TOML files, and folders on the way to them."""
    return _files(incomplete, (".toml",))


def profiles(incomplete: str) -> list[str]:
    """Bundled profiles."""
    return _bundled(incomplete, "monitor/profiles")


def scenarios(incomplete: str) -> list[str]:
    """Bundled scenarios, or a file of one's own."""
    return _bundled(incomplete, "sim_feeds/scenarios") + settings_files(incomplete)


def airframes(incomplete: str) -> list[str]:
    """Bundled airframes, or a file of one's own."""
    return _bundled(incomplete, "links/airframes") + settings_files(incomplete)


def links(incomplete: str) -> list[str]:
    """Connection strings to begin with, serial devices that are there, logs."""
    from glob import glob

    devices = [device for pattern in SERIAL for device in sorted(glob(pattern))]
    heads = [word for word in (*LINKS, *devices) if word.startswith(incomplete)]
    return heads + (_files(incomplete, (".tlog",)) if incomplete else [])


def setting_keys(incomplete: str) -> list[str]:
    """Sections, and the keys of the section that is typed."""
    from monitor.settings.explained import sections_of

    sections = sections_of()
    keys = [key for keys in sections.values() for key in keys]
    if incomplete.rstrip(".") in sections or "." in incomplete:
        return [key for key in keys if key.startswith(incomplete)]
    return [name for name in sections if name.startswith(incomplete)]
