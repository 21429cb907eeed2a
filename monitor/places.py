"""Where the daemon keeps what must outlive it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

__all__ = ["STATE_VARIABLE", "state_folder"]

STATE_VARIABLE = "STATE_DIRECTORY"
"""Variable by which a service manager names the folder that it made; several stand apart by colons,
the first is taken."""


def state_folder(environ: Mapping[str, str] = os.environ) -> Path:
    """Folder of the state: the service manager's, else the user's; not made here.

    Parameters
    ----------
    environ
        The environment.
    """
    if given := environ.get(STATE_VARIABLE, "").partition(":")[0]:
        return Path(given)
    from platformdirs import user_state_path

    return user_state_path("mavsentry", appauthor=False)
