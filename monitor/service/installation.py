"""The service on a computer: which files make it, and the steps that bring them there or away.

Nothing is done here but by :meth:`Step.do`: a plan can be shown, done below another root (an image
that is being built), and done again. What is there as wanted is left alone; a configuration is
never written over.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

__all__ = [
    "CACHE",
    "CONFIG",
    "UNIT",
    "Place",
    "Step",
    "below",
    "hidden_from_service",
    "installing",
    "removing",
    "rules_text",
    "unit_text",
]

UNIT = Path("/etc/systemd/system/mavsentry.service")
WANTED = Path("/etc/systemd/system/multi-user.target.wants/mavsentry.service")
CHANGES = Path("/etc/systemd/system/mavsentry.service.d")
CONFIG = Path("/etc/mavsentry/mavsentry.toml")
RULES = Path("/etc/udev/rules.d/70-mavsentry.rules")
CACHE = Path("/var/cache/mavsentry/kernels")
KEPT = tuple(
    Path(folder, "mavsentry")
    for folder in ("/etc", "/var/lib", "/var/lib/private", "/var/cache", "/var/cache/private")
)
"""What outlives the program, and a purge does not; of a user of its own systemd keeps the folders
under ``private``."""

HIDDEN = tuple(Path(folder) for folder in ("/home", "/root", "/run/user", "/tmp", "/var/tmp"))
"""What the unit's ProtectHome and PrivateTmp hide."""

SERIAL_GROUPS = ("dialout", "uucp")
"""Who owns serial ports: Debian and Fedora, Arch."""

_EXEC = re.compile(r"^ExecStart=.*$", re.M)
_GROUPS = re.compile(r"^SupplementaryGroups=.*\n", re.M)


@dataclass(frozen=True, slots=True)
class Place:
    """What the service is made of on this computer.

    Attributes
    ----------
    root
        ``/``, or a folder that is the root of an image.
    program
        The command, as the service finds it.
    """

    root: Path
    program: Path


@dataclass(frozen=True, slots=True)
class Step:
    """One file, link or folder that is brought to what it should be.

    Attributes
    ----------
    path
        Place of it, the root included.
    text
        Content of a file; None: no file.
    target
        What a link points to; None: no link. Neither: ``path`` is removed, with all that is in it.
    keep
        A file that is there stays as it is.
    """

    path: Path
    text: str | None = None
    target: Path | None = None
    keep: bool = False

    @property
    def says(self) -> str:
        """What is to be done: ``write``, ``keep``, ``link``, ``remove`` or nothing."""
        there = os.path.lexists(self.path)
        if self.text is not None:
            if there and (self.keep or _content(self.path) == self.text):
                return "keep"
            return "write"
        if self.target is not None:
            same = self.path.is_symlink() and self.path.readlink() == self.target
            return "keep" if same else "link"
        return "remove" if there else ""

    def do(self) -> None:
        """Do it; raises OSError if that cannot be done."""
        match self.says:
            case "write":
                self.path.parent.mkdir(parents=True, exist_ok=True)
                beside = self.path.with_name(f".{self.path.name}.new")
                beside.write_text(self.text or "", encoding="utf-8")
                beside.chmod(0o644)
                beside.replace(self.path)
            case "link":
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.unlink(missing_ok=True)
                self.path.symlink_to(self.target or "")
            case "remove":
                if self.path.is_dir() and not self.path.is_symlink():
                    shutil.rmtree(self.path)
                else:
                    self.path.unlink()


def installing(place: Place, config: str, inputs: Sequence[str]) -> list[Step]:
    """Files of a service that starts with the computer.

    Parameters
    ----------
    place
        Where, and which program.
    config
        Configuration to begin with; one that is there stays.
    inputs
        Links in force: of their USB serial ports the modem manager is kept away.
    """
    rules = rules_text(inputs)
    return [
        Step(below(place.root, CONFIG), text=config, keep=True),
        Step(below(place.root, RULES), text=rules or None),
        Step(below(place.root, UNIT), text=unit_text(place.program, serial_group(place.root))),
        Step(below(place.root, WANTED), target=UNIT),
    ]


def removing(root: Path, purge: bool) -> list[Step]:
    """What an uninstallation takes away; ``purge``: with configuration, state and recordings."""
    paths = [WANTED, UNIT, RULES, *((CHANGES, *KEPT) if purge else ())]
    return [Step(below(root, path)) for path in paths]


def below(root: Path, path: Path) -> Path:
    """A path of the system below another root."""
    return root / path.relative_to("/")


def unit_text(program: Path, group: str | None = SERIAL_GROUPS[0]) -> str:
    """The unit, for this program and the group that owns serial ports (None: there is none)."""
    text = resources.files("monitor.service").joinpath("mavsentry.service").read_text("utf-8")
    command = f'"{program}"' if re.search(r"\s", str(program)) else str(program)
    start = f"ExecStart={command.replace('%', '%%')} run --config {CONFIG}"
    groups = f"SupplementaryGroups={group}\n" if group else ""
    return _GROUPS.sub(groups, _EXEC.sub(lambda _: start, text))


def rules_text(inputs: Sequence[str]) -> str:
    """Rules of udev that keep ModemManager off the USB serial ports of these links.

    ModemManager talks to any new ``ttyACM`` to see whether it is a modem, in the autopilot's first
    seconds. Empty where no link is such a port.
    """
    matches = []
    for link in inputs:
        name = link.partition(":")[0]
        if found := re.fullmatch(r"/dev/serial/by-id/usb-(.+?)(?:-if\d+\S*|\*)?", name):
            matches.append(f'ENV{{ID_SERIAL}}=="{found[1]}"')
        elif found := re.fullmatch(r"/dev/(tty(?:ACM|USB)\d+)", name):
            matches.append(f'KERNEL=="{found[1]}"')
    return "".join(
        f'ACTION=="add|change", SUBSYSTEM=="tty", {match}, ENV{{ID_MM_PORT_IGNORE}}="1"\n'
        for match in dict.fromkeys(matches)
    )


def serial_group(root: Path) -> str | None:
    """Group that owns serial ports on the system below ``root``; None if none is known."""
    groups = {line.partition(":")[0] for line in (_content(root / "etc/group") or "").splitlines()}
    return next((group for group in SERIAL_GROUPS if group in groups), None)


def hidden_from_service(*paths: Path) -> Path | None:
    """The first of these paths that the service cannot see; None if it sees all."""
    return next((p for p in paths if any(p.is_relative_to(folder) for folder in HIDDEN)), None)


def _content(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
