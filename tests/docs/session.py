"""A page's own folder, in which its commands are typed one after another."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.conftest import ROOT
from tests.docs.console import Command, lasts
from tests.docs.expected import agrees
from tests.docs.pages import Wrong

TOOLS = """
awk basename bash cat chmod cmp cp curl cut date diff dirname du echo env find grep gzip head ln ls
mkdir mv printf rm sed seq sh sleep sort stat tail tee touch tr true uniq wc xargs
"""
"""Programs of the system that a page may run."""

HOME = "/home/pi"
"""What the page's folder is called in what is printed."""
COMMAND_S = 120.0
READY_S = 60.0
END_S = 20.0

_LINK = re.compile(r"\b(udpin|udpout|tcp|tcpin):([\w.\-*]*):(\d{2,5})\b")
_LOCAL = re.compile(r"\b(127\.0\.0\.1|0\.0\.0\.0|localhost):(\d{2,5})\b")
_LISTENS = re.compile(r"(?:udpin:|tcpin:|--web[ =])127\.0\.0\.1:(\d+)")
_KEEP = 'code=$?; { declare -px; printf "cd %%q\\n" "$PWD"; } >%s; exit $code'
_DEFAULTS = (
    ("run", "--in|--config", "--in udpin:127.0.0.1:14550"),
    ("(?:feed|replay)", "--to", "--to udpout:127.0.0.1:14550"),
)


@dataclass
class Ports:
    """Each port that a page names is a free one here."""

    free: dict[str, str] = field(default_factory=dict)

    def here(self, text: str) -> str:
        """The same with free ports of the loopback."""
        text = _LINK.sub(lambda m: f"{m[1]}:127.0.0.1:{self._free(m[3])}", text)
        return _LOCAL.sub(lambda m: f"127.0.0.1:{self._free(m[2])}", text)

    def there(self, text: str) -> str:
        """The same with the ports of the page."""
        for port, free in self.free.items():
            text = re.sub(rf"(?<=:){free}\b", port, text)
        return text

    def _free(self, port: str) -> str:
        if port not in self.free and port not in self.free.values():
            with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
                tcp.bind(("127.0.0.1", 0))
                udp.bind(("127.0.0.1", tcp.getsockname()[1]))
                self.free[port] = str(tcp.getsockname()[1])
        return self.free.get(port, port)


@dataclass
class _Lasting:
    command: Command
    numbers: str
    process: subprocess.Popen[bytes]
    output: Path


class Session:
    """The folder, its environment and what goes on in it.

    Parameters
    ----------
    folder
        Empty.
    programs
        Folder with ``mavsentry`` and ``python``.
    """

    def __init__(self, folder: Path, programs: Path) -> None:
        self.folder = folder / "pi"
        self.folder.mkdir(parents=True)
        self.ports = Ports()
        self._state = folder / "state"
        self._state.touch()
        tools = folder / "tools"
        tools.mkdir()
        for name in TOOLS.split():
            if found := shutil.which(name):
                (tools / name).symlink_to(found)
        kept = ("MAVSENTRY_CACHE_DIR", "NUMBA_CACHE_DIR", "LANG", "TMPDIR")
        self.environment = {name: os.environ[name] for name in kept if name in os.environ} | {
            "HOME": str(self.folder),
            "PATH": f"{programs}:{tools}",
            "PYTHONPATH": str(ROOT),
            "COLUMNS": "120",
            "PYTHONWARNINGS": "ignore",
            "OPENBLAS_NUM_THREADS": "1",
        }
        self._lasting: list[_Lasting] = []
        self._count = 0

    def write(self, name: str, text: str) -> Path:
        """A file of the page, where its commands find it."""
        file = self.folder / Path(name).name
        file.write_text(self.ports.here(text), "utf-8")
        return file

    def type(self, command: Command, status: int = 0, numbers: str = "") -> None:
        """Run a command to its end, or as far as its lines go if it lasts.

        Raises
        ------
        Wrong
            If it ends otherwise or prints something else than the page says.
        """
        text = self.ports.here(_explicit(command.text))
        if command.interrupted or lasts(command.text):
            self._begin(command, text, numbers)
            if command.interrupted:
                self._end(self._lasting.pop())
            return
        script = f"source {self._state}\n{text}\n" + _KEEP % shlex.quote(str(self._state))
        try:
            done = subprocess.run(
                ["bash", "-c", script],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=COMMAND_S,
            )
        except subprocess.TimeoutExpired as late:
            raise Wrong(f"$ {command.text}\n  takes more than {COMMAND_S:.0f} s") from late
        said = self._said(done.stdout)
        if done.returncode != status:
            raise Wrong(f"$ {command.text}\n  ends with {done.returncode}:\n{said}")
        if command.expected and not agrees(command.expected, said, numbers):
            raise Wrong(f"$ {command.text}\n  prints:\n{said}")

    def close(self) -> None:
        """End what lasts, and hold all it said against the page.

        Raises
        ------
        Wrong
            Of the first that did not end or said something else.
        """
        wrong = None
        for lasting in reversed(self._lasting):
            try:
                self._end(lasting)
            except Wrong as error:
                wrong = wrong or error
        self._lasting.clear()
        if wrong:
            raise wrong

    def _said(self, output: bytes) -> str:
        text = output.decode("utf-8", "replace")
        return self.ports.there(text.replace(str(self.folder), HOME))

    def _begin(self, command: Command, text: str, numbers: str) -> None:
        self._count += 1
        output = self._state.with_name(f"lasting-{self._count}")
        with output.open("wb") as file:
            process = subprocess.Popen(
                ["bash", "-c", f"source {self._state}\nexec {text.rstrip().rstrip('&')}"],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        lasting = _Lasting(command, numbers, process, output)
        self._lasting.append(lasting)
        until = time.monotonic() + READY_S
        while not self._ready(lasting, text):
            if process.poll() is not None or time.monotonic() > until:
                if self._ready(lasting, text):
                    break
                said = self._said(output.read_bytes())
                raise Wrong(f"$ {command.text}\n  status {process.poll()}, so far:\n{said}")
            time.sleep(0.05)

    def _ready(self, lasting: _Lasting, text: str) -> bool:
        if lasting.command.expected:
            said = self._said(lasting.output.read_bytes())
            return agrees(lasting.command.expected, said, lasting.numbers, so_far=True)
        named = _LISTENS.findall(text)
        return all(_bound(int(port)) for port in named) and bool(
            named or lasting.output.stat().st_size or lasting.process.poll() == 0
        )

    def _end(self, lasting: _Lasting) -> None:
        process = lasting.process
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        try:
            status = process.wait(END_S)
        except subprocess.TimeoutExpired as late:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise Wrong(f"$ {lasting.command.text}\n  does not end on Ctrl-C") from late
        if status not in (0, 130):
            said = self._said(lasting.output.read_bytes())
            raise Wrong(f"$ {lasting.command.text}\n  ends with {status}:\n{said}")


def _explicit(text: str) -> str:
    """With the link that is the default, so that it can be another."""
    for command, given, link in _DEFAULTS:
        without = rf"(?m)^mavsentry {command}(?!.*(?:{given}|--help| -h\b))"
        text = re.sub(without, rf"\g<0> {link}", text)
    return text


def _bound(port: int) -> bool:
    """Whether somebody listens there."""
    wanted = f":{port:04X} "
    for table in ("udp", "tcp", "udp6", "tcp6"):
        file = Path("/proc/net") / table
        if file.exists() and any(wanted in line[:45] for line in file.read_text().splitlines()):
            return True
    return False
