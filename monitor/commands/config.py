"""``mavsentry config``: write a commented file, check one, show what is in force."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from monitor.commands.common import ConfigFile, Profile, Refused, load_settings, note
from monitor.toml import toml_value

if TYPE_CHECKING:
    from pydantic import BaseModel

__all__ = ["app"]

app = typer.Typer(help="Write, check and show settings.", no_args_is_help=False)

_HEAD = """\
# mavsentry settings. Every key is shown with the value that the profile gives it;
# take the # from a key to set it. `mavsentry config check FILE` says what is wrong with a file.

profile = "{profile}"
"""


@app.command()
def init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("sentry.toml"),
    profile: Profile = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Write a file with every key, its meaning and its value, all commented out."""
    settings = load_settings(profile, None)
    if file.exists() and not force:
        raise Refused(f"{file} is there already; --force overwrites it")
    try:
        file.write_text(_template(settings), encoding="utf-8")
    except OSError as error:
        raise Refused(f"cannot write {file}: {error.strerror}") from None
    print(f"wrote {file}")


@app.command()
def check(file: Annotated[Path, typer.Argument(help="File to check.")]) -> None:
    """Say whether a file of settings can be used."""
    settings = load_settings(None, file)
    print(f"{file} is good: profile {settings.profile}")


@app.command()
def show(
    config: ConfigFile = None,
    profile: Profile = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="As `run` takes them: with what was set over MAVLink and is kept."
        ),
    ] = False,
) -> None:
    """Show every key in force and where its value comes from."""
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
    values = dict(_flat(settings.model_dump()))
    values["learnt.logs"] = [log["name"] for log in values["learnt.logs"]]
    wide = max(
        len(f"{key} = {toml_value(value)}") for key, value in values.items() if len(key) < 60
    )
    for key, value in values.items():
        setting = f"{key} = {toml_value(value)}"
        print(f"{setting:<{min(wide, 60)}}  # {came_from[key]}")


def _template(settings: BaseModel) -> str:
    return _HEAD.format(profile=settings.model_dump()["profile"]) + "".join(_sections(settings, ""))


def _sections(model: BaseModel, name: str) -> Iterator[str]:
    """TOML of a section: its keys first, then its subsections."""
    from pydantic import BaseModel

    if name:
        about = (type(model).__doc__ or "").strip().splitlines()
        yield f"\n[{name}]" + (f"  # {about[0]}\n" if about else "\n")
    fields = type(model).model_fields
    for key, field in fields.items():
        value = getattr(model, key)
        if isinstance(value, BaseModel) or (not name and key == "profile"):
            continue
        for text in textwrap.wrap(field.description or "", 92):
            yield f"# {text}\n"
        yield f"# {key} = {toml_value(value)}\n"
    for key in fields:
        value = getattr(model, key)
        if isinstance(value, BaseModel) and key != "learnt":  # which `mavsentry learn` writes
            yield from _sections(value, f"{name}.{key}" if name else key)


def _flat(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
