"""A process that has the program loaded already, and copies of it that run one command each.

``mavsentry`` takes a second to load numpy and numba, and more for its kernels. Here a process does
that once; whoever calls its ``mavsentry`` (``call.py`` in a folder on the PATH) sends it arguments,
folder, environment and the three standard streams, and a fork of it runs the command with them.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

LOADED = (
    "monitor.cli",
    "monitor.analyze",
    "monitor.commands.analysis_shown",
    "monitor.commands.live.assembly",
    "monitor.daemon",
    "monitor.report",
    "monitor.warmup",
    "sim_feeds.player",
    "sim_feeds.scenario",
)
CALL = Path(__file__).with_name("call.py")


class Warm:
    """The process, as the tests hold it.

    Parameters
    ----------
    folder
        For its socket, the ``mavsentry`` that calls it and the ``python`` of this environment.
    """

    def __init__(self, folder: Path) -> None:
        self.programs = folder / "bin"
        self.programs.mkdir()
        socket_file = folder / "s"
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(socket_file))
        self._listener.listen()
        self._script("mavsentry", f"exec {sys.executable} -I -S {CALL} {socket_file} ")
        for name in ("python", "python3"):
            self._script(name, f"exec {sys.executable} ")
        self._script("pytest", f"exec {sys.executable} -m pytest -p no:cacheprovider ")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.docs.warm", str(self._listener.fileno())],
            pass_fds=[self._listener.fileno()],
            stdin=subprocess.DEVNULL,
            cwd=Path(__file__).parents[2],
        )

    def _script(self, name: str, command: str) -> None:
        file = self.programs / name
        file.write_text(f'#!/bin/sh\n{command}"$@"\n')
        file.chmod(0o755)

    def close(self) -> None:
        """End it; commands that run go on to their end."""
        self._process.terminate()
        self._process.wait(10)
        self._listener.close()


def serve(listener: socket.socket) -> None:
    """Fork for each caller, until terminated."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        caller, _ = listener.accept()
        if os.fork() == 0:
            listener.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            _attend(caller)
            os._exit(0)
        caller.close()


def _attend(caller: socket.socket) -> None:
    """Have one command run, tell its process id and its status; end it if the caller is gone."""
    head, streams, _, _ = socket.recv_fds(caller, 8, 3)
    size, text = int(head), b""
    while len(text) < size:
        text += caller.recv(size - len(text))
    process = os.fork()
    if process == 0:
        caller.close()
        _become(json.loads(text), streams)
    for stream in streams:
        os.close(stream)
    caller.sendall(b"%8d" % process)
    ended = os.pidfd_open(process)
    if ended not in select.select([ended, caller], [], [])[0]:
        os.kill(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    code = os.waitstatus_to_exitcode(status)
    caller.sendall(b"%8d" % (code if code >= 0 else 128 - code))


def _become(request: dict[str, Any], streams: list[int]) -> None:
    """Be the process that the caller asked for."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for target, stream in enumerate(streams):
        os.dup2(stream, target)
        os.close(stream)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = ["mavsentry", *request["arguments"]]
    import monitor.cli

    sys.modules["__main__"] = monitor.cli  # processes that it starts import this one
    status: object = 1
    try:
        monitor.cli.main()
    except SystemExit as end:
        status = end.code
    except BaseException:
        sys.excepthook(*sys.exc_info())
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(status if isinstance(status, int) else 0)


def load() -> None:
    """What nearly every command would load itself."""
    for module in LOADED:
        import_module(module)


if __name__ == "__main__":
    load()
    serve(socket.socket(fileno=int(sys.argv[1])))
