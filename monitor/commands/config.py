"""``mavsentry config``: write a commented file, check one, show what is in force and why."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands import completing
from monitor.commands.common import ConfigFile, Profile, Refused, load_settings, note
from monitor.commands.helping import App
from monitor.toml import toml_value

if TYPE_CHECKING:
    from monitor.settings import Settings
    from monitor.settings.explained import Key

__all__ = ["app"]

app = App(help="Write, check and show settings.")

UNUSABLE = 2
WIDEST = 60
"""Longer settings do not push the origins of all others to the right."""


@app.command()
def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write.")] = Path(
        "sentry.toml"
    ),
    profile: Profile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Write a file with every key, its meaning and its value, all commented out."""
    settings = load_settings(profile, None)
    from monitor.settings.explained import commented

    if file.exists() and not force:
        raise Refused(f"{file} is there already; --force overwrites it, another name keeps both")
    try:
        file.write_text(commented(settings), encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write {file}: {error.strerror}") from None
    print(f"wrote {file}")


@app.command()
def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="File to check.", autocompletion=completing.settings_files
        ),
    ],
) -> None:
    """Say whether a file of settings can be used, and all that is wrong with it."""
    from monitor.settings import SettingsError, load

    try:
        settings = load(None, file)
    except SettingsError as error:
        for problem in error.problems:
            note(f"mavsentry: {problem}")
        raise typer.Exit(UNUSABLE) from None
    print(f"{file} is good: profile {settings.profile}")


@app.command()
def show(
    key: Annotated[
        str | None,
        typer.Argument(
            metavar="KEY",
            help="A key, such as air.confirm_s, or a section, such as air; without it everything.",
            autocompletion=completing.setting_keys,
        ),
    ] = None,
    config: ConfigFile = None,
    profile: Profile = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="As `run` takes them: with what was set over MAVLink and is kept."
        ),
    ] = False,
) -> None:
    """Show keys in force and where each value comes from.

    A later layer wins: the default, then the profile, then the file, then what was set over MAVLink
    (--live). A single key is shown with its meaning, its limits and what every layer says.
    """
    settings = load_settings(profile, config)
    from monitor.settings import origins

    came_from = origins(profile, config)
    if live:
        from monitor.component.parameter_file import parameter_path, read_parameters
        from monitor.retune import with_values

        own, unused = read_parameters(parameter_path(settings), settings)
        if unused is not None:
            note(f"mavsentry: {unused}")
        settings = with_values(settings, own)
        came_from |= dict.fromkeys(own, "parameter")
    if key is not None and (found := _key(key)) is not None:
        _explain(found, settings, came_from, profile, config)
        return
    values = {name: _shown(name, settings) for name in came_from}
    if key is not None:
        values = {k: v for k, v in values.items() if k == key or k.startswith(f"{key}.")}
    settings_lines = {name: f"{name} = {text}" for name, text in values.items()}
    wide = max((len(line) for line in settings_lines.values() if len(line) < WIDEST), default=0)
    for name, line in settings_lines.items():
        print(f"{line:<{wide}}  # {came_from[name]}")


def _key(typed: str) -> Key | None:
    """The key that is called so; None for a section.

    Raises
    ------
    Refused
        Neither a key nor a section.
    """
    from monitor.settings.explained import keys_of, near_keys

    keys = {key.name: key for key, _ in keys_of()}
    if typed in keys:
        return keys[typed]
    if any(name.startswith(f"{typed}.") for name in keys):
        return None
    near = " or ".join(near_keys(typed))
    hint = f"did you mean {near}?" if near else "`mavsentry config show` lists them all"
    raise Refused(f"there is no key or section {typed}; {hint}")


def _explain(
    key: Key,
    settings: Settings,
    came_from: dict[str, str],
    profile: str | None,
    config: Path | None,
) -> None:
    """One key in full: value, meaning, limits, layers, the MAVLink parameter of it."""
    from monitor.component.tunables import TUNABLES
    from monitor.settings.explained import layers_of

    print(f"{key.name} = {_shown(key.name, settings)}")
    for line in textwrap.wrap(key.meaning, 92):
        print(f"  {line}")
    if key.limits:
        print(f"  takes: {key.limits}")
    if parameter := next((t.name for t in TUNABLES if t.key == key.name), None):
        print(f"  in flight: the MAVLink parameter {parameter}")
    layers = [(layer.origin, layer.value) for layer in layers_of(key, profile, config)]
    if came_from.get(key.name) == "parameter":
        layers.append(("parameter", _value(key.name, settings)))
    wide = max(len(origin) for origin, _ in layers)
    for k, (origin, value) in enumerate(layers, 1):
        mark = "  <- in force" if k == len(layers) else ""
        print(f"  {origin:<{wide}}  {toml_value(_plain(value))}{mark}")


def _value(name: str, settings: Settings) -> Any:
    from monitor.settings.explained import value_at

    return _plain(value_at(settings, name))


def _plain(value: Any) -> Any:
    """Tables of a section's own kind as tables."""
    from pydantic import BaseModel

    if isinstance(value, BaseModel):
        return value.model_dump()
    if isinstance(value, dict):
        return {name: _plain(below) for name, below in value.items()}
    return value


def _shown(name: str, settings: Settings) -> str:
    value = _value(name, settings)
    if name == "learnt.logs":
        value = [log.name for log in value]
    return toml_value(value)
