"""The configuration: validated once, a unit in every key, and where each value came from.

Three layers, later ones win key by key: the defaults in the section classes, the profile of an
airframe class (``monitor/profiles/*.toml``), and the user's own file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from monitor.settings.air import AirSettings
from monitor.settings.base import Section
from monitor.settings.checkpoint import CheckpointSettings
from monitor.settings.component import ComponentSettings
from monitor.settings.engine import EngineSettings
from monitor.settings.imu import ImuSettings
from monitor.settings.learnt import LearntSettings
from monitor.settings.links import LinkSettings
from monitor.settings.log import LogSettings
from monitor.settings.mute import MuteSettings
from monitor.settings.phase import PhaseSettings
from monitor.settings.problems import problems
from monitor.settings.publish import PublishSettings
from monitor.settings.recorder import RecorderSettings
from monitor.settings.security import SecuritySettings
from monitor.settings.streams import StreamSettings
from monitor.settings.triplex import TriplexSettings
from monitor.settings.vane import VaneSettings
from monitor.settings.web import WebSettings
from monitor.settings.wing import WingSettings

__all__ = [
    "DEFAULT_PROFILE",
    "PROFILES",
    "Settings",
    "SettingsError",
    "by_hand",
    "changed",
    "load",
    "origins",
]

PROFILES = ("small-uav", "light-aircraft", "transport")
"""Bundled airframe classes; the first is the default."""
DEFAULT_PROFILE = PROFILES[0]


class SettingsError(ValueError):
    """A configuration that cannot be used, in one plain sentence.

    Parameters
    ----------
    problems
        Every problem, a sentence each; the error itself says the first, and how many more.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = problems
        more = len(problems) - 1
        one = "one more problem is" if more == 1 else f"{more} more problems are"
        super().__init__(
            f"{problems[0]} ({one} listed by `mavsentry config check`)" if more else problems[0]
        )


class Settings(Section):
    """All of the configuration."""

    profile: str = Field(DEFAULT_PROFILE, description="Airframe class whose values are the base.")
    links: LinkSettings = Field(default_factory=LinkSettings)
    component: ComponentSettings = Field(default_factory=ComponentSettings)
    streams: StreamSettings = Field(default_factory=StreamSettings)
    phase: PhaseSettings = Field(default_factory=PhaseSettings)
    imu: ImuSettings = Field(default_factory=ImuSettings)
    air: AirSettings = Field(default_factory=AirSettings)
    triplex: TriplexSettings = Field(default_factory=TriplexSettings)
    vane: VaneSettings = Field(default_factory=VaneSettings)
    engine: EngineSettings = Field(default_factory=EngineSettings)
    wing: WingSettings = Field(default_factory=WingSettings)
    mute: MuteSettings = Field(default_factory=MuteSettings)
    publish: PublishSettings = Field(default_factory=PublishSettings)
    recorder: RecorderSettings = Field(default_factory=RecorderSettings)
    security: SecuritySettings = Field(default_factory=SecuritySettings)
    checkpoint: CheckpointSettings = Field(default_factory=CheckpointSettings)
    web: WebSettings = Field(default_factory=WebSettings)
    log: LogSettings = Field(default_factory=LogSettings)
    learnt: LearntSettings = Field(default_factory=LearntSettings)


def load(profile: str | None = None, file: Path | None = None) -> Settings:
    """Settings of a profile with the keys of a file over them.

    Parameters
    ----------
    profile
        One of :data:`PROFILES`; None takes the file's ``profile`` key, else the default.
    file
        TOML file with any subset of the keys.

    Raises
    ------
    SettingsError
        File unreadable, not TOML, an unknown key or profile, or a value out of its range.
    """
    return _validated(_read(file) if file is not None else {}, profile, file)


def by_hand(profile: str | None, file: Path | None) -> tuple[Settings, dict[str, Any]]:
    """The same without what was learnt, and the tables that the file sets by hand.

    What `mavsentry learn` starts from: keys that it wrote into the file before are learnt anew.

    Raises
    ------
    SettingsError
        As of :func:`load`.
    """
    settings = load(profile, file)
    own = _read(file) if file is not None else {}
    tables = _without({k: v for k, v in own.items() if k not in ("profile", "learnt")}, settings)
    return _validated(tables, settings.profile, file), tables


def _without(values: Mapping[str, Any], settings: Settings, prefix: str = "") -> dict[str, Any]:
    """The values without learnt keys, and without tables that have no others."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            rest = _without(value, settings, f"{prefix}{key}.")
            if rest:
                out[key] = rest
        elif prefix + key not in settings.learnt.keys:
            out[key] = value
    return out


def _validated(own: Mapping[str, Any], profile: str | None, file: Path | None) -> Settings:
    name = profile or own.get("profile", DEFAULT_PROFILE)
    if name not in PROFILES:
        raise SettingsError(f"there is no profile {name!r}; choose one of {', '.join(PROFILES)}")
    values = _merged(_profile_values(name), own) | {"profile": name}
    try:
        return Settings.model_validate(values)
    except ValidationError as error:
        raise SettingsError(*problems(error, Settings, file)) from None


def origins(profile: str | None = None, file: Path | None = None) -> dict[str, str]:
    """Dotted key -> where its value came from.

    ``default``, ``profile NAME``, the file's name, or that and how many flights it was learnt from.
    """
    settings = load(profile, file)
    own = _flat(_read(file)) if file is not None else {}
    base = _flat(_profile_values(settings.profile))
    learnt = settings.learnt
    return {
        key: f"{file}, {learnt.origin}"
        if key in learnt.keys and learnt.logs
        else str(file)
        if key in own
        else f"profile {settings.profile}"
        if key in base
        else "default"
        for key in _flat(settings.model_dump())
    }


def changed(settings: Settings) -> dict[str, Any]:
    """Dotted key -> value of what differs from the settings' profile, in JSON's types.

    Provenance of learnt thresholds, which changes no verdict, is left out.
    """
    base = _flat(load(settings.profile).model_dump(mode="json", exclude={"learnt"}))
    own = _flat(settings.model_dump(mode="json", exclude={"learnt"}))
    return {key: value for key, value in own.items() if key not in base or base[key] != value}


def _profile_values(name: str) -> dict[str, Any]:
    text = resources.files("monitor").joinpath("profiles", f"{name}.toml").read_text("utf-8")
    return tomllib.loads(text)


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        hint = "; `mavsentry config init` writes one" if not file.exists() else ""
        raise SettingsError(f"cannot read {file}: {error.strerror}{hint}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{file} is not valid TOML: {error}") from None


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(base)
    for key, value in over.items():
        below = out.get(key)
        if isinstance(value, Mapping) and isinstance(below, Mapping):
            out[key] = _merged(below, value)
        else:
            out[key] = value
    return out


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            out |= _flat(value, f"{prefix}{key}.")
        else:
            out[prefix + key] = value
    return out
