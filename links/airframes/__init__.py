"""Airframes as tables of numbers: one TOML file each, read by whoever models the aircraft."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

__all__ = ["BUNDLED", "AirframeError", "load_airframe"]

BUNDLED = ("aerosonde",)


class AirframeError(ValueError):
    """The airframe cannot be read; the message says why."""


def load_airframe(name_or_path: str | Path) -> dict[str, float]:
    """Numbers of an airframe by their key, sections merged.

    Parameters
    ----------
    name_or_path
        One of :data:`BUNDLED`, or a TOML file of the same form.

    Raises
    ------
    AirframeError
        No such file, no TOML, a value that is no number, or a key that stands twice.
    """
    if name_or_path in BUNDLED:
        text = (files("links.airframes") / f"{name_or_path}.toml").read_text(encoding="utf-8")
    else:
        path = Path(name_or_path)
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            known = ", ".join(BUNDLED)
            raise AirframeError(
                f"cannot read airframe {path}: {error.strerror} (bundled: {known})"
            ) from None
        except UnicodeDecodeError:
            raise AirframeError(f"airframe {path} is no text") from None
    try:
        table: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise AirframeError(f"airframe {name_or_path}: {error}") from None
    numbers: dict[str, float] = {}
    for section, entries in table.items():
        if not isinstance(entries, dict):
            continue
        for key, value in entries.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise AirframeError(f"airframe {name_or_path}: {section}.{key} is no number")
            if key in numbers:
                raise AirframeError(f"airframe {name_or_path}: {key} stands twice")
            numbers[key] = float(value)
    return numbers
