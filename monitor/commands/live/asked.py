"""What ``run`` is to do: its options over the configuration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from monitor.settings import Settings

__all__ = ["Asked"]


class Asked(NamedTuple):
    """The options of ``run``; what is None or empty is left to the configuration.

    Attributes
    ----------
    profile, config
        As of every command.
    inputs, outputs
        Links: ``[links] inputs`` and ``outputs``.
    system_id
        The vehicle: ``[links] system_id``.
    record
        Folder: ``[recorder] folder``.
    web
        Address: ``[web] address``.
    log
        Where events go: ``[log] to``.
    """

    profile: str | None = None
    config: Path | None = None
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    system_id: int | None = None
    record: Path | None = None
    web: str | None = None
    log: str | None = None

    def settings(self) -> Settings:
        """The configuration as it stands on the disk now, with the options in it.

        Raises
        ------
        SettingsError
            The profile, the file or one of its keys cannot be used.
        """
        from monitor.settings import load

        settings = load(self.profile, self.config)
        given: dict[str, dict[str, Any]] = {
            "links": {
                "inputs": self.inputs or None,
                "outputs": self.outputs or None,
                "system_id": self.system_id,
            },
            "recorder": {"folder": None if self.record is None else str(self.record)},
            "web": {"address": self.web},
            "log": {"to": self.log},
        }
        sections = {}
        for section, values in given.items():
            over = {key: value for key, value in values.items() if value is not None}
            if over:
                sections[section] = getattr(settings, section).model_copy(update=over)
        return settings.model_copy(update=sections)
