"""How soon the command answers: ``mavsentry --help`` against ``import numpy`` alone."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence

from monitor.commands.bench_cases import BenchCase, Measured

__all__ = ["HELP", "NUMPY", "cases", "cpu_s"]

HELP = ("-c", "import sys; sys.argv[1:] = ['--help']; from monitor.cli import main; main()")
"""What the installed command does."""

NUMPY = ("-c", "import numpy")
ROUNDS = 15


def cases() -> list[BenchCase]:
    """The one case."""
    return [
        BenchCase(
            "help_start",
            unit="times a bare import numpy",
            value=_help_start,
            note="processor time of `mavsentry --help` and of `python -c 'import numpy'`, "
            "interleaved, medians",
        )
    ]


def _help_start() -> Measured:
    taken_s = cpu_s({"help": HELP, "numpy": NUMPY}, ROUNDS)
    ours_s, numpy_s = (statistics.median(taken_s[name]) for name in ("help", "numpy"))
    return Measured(
        ours_s / numpy_s,
        1e6 * ours_s,
        1e6 * max(taken_s["help"]),
        f"{1e3 * ours_s:.0f} ms against {1e3 * numpy_s:.0f} ms",
    )


def cpu_s(programs: Mapping[str, Sequence[str]], rounds: int) -> dict[str, list[float]]:
    """Processor time of each Python program [s], one after another, the first round not counted.

    Parameters
    ----------
    programs
        Name -> arguments of this interpreter.
    rounds
        How often each is run and counted.

    Raises
    ------
    subprocess.CalledProcessError
        One of them failed.
    """
    taken: dict[str, list[float]] = {name: [] for name in programs}
    for counted in range(rounds + 1):
        for name, arguments in programs.items():
            command = [sys.executable, *arguments]
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise subprocess.CalledProcessError(process.returncode, command)
            if counted:
                taken[name].append(used.ru_utime + used.ru_stime)
    return taken
