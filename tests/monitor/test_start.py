"""The command answers at once: its help takes little more than an import of numpy."""

import subprocess

import pytest

from monitor.commands.bench_cases.start import HELP, NUMPY, cases, cpu_s

AT_MOST = 4.0
"""Times a bare import of numpy."""


@pytest.mark.alone
def test_the_help_takes_at_most_four_times_an_import_of_numpy() -> None:
    taken_s = cpu_s({"help": HELP, "numpy": NUMPY}, rounds=7)
    assert min(taken_s["help"]) < AT_MOST * min(taken_s["numpy"])


def test_what_takes_long_is_seen() -> None:
    taken_s = cpu_s({"short": ("-c", ""), "long": ("-c", "sum(range(20_000_000))")}, rounds=1)
    assert min(taken_s["long"]) > AT_MOST * min(taken_s["short"])


def test_a_program_that_fails_is_not_a_time() -> None:
    with pytest.raises(subprocess.CalledProcessError):
        cpu_s({"fails": ("-c", "raise SystemExit(3)")}, rounds=1)


def test_the_case_is_named_as_it_is_asked_for() -> None:
    assert [case.name for case in cases()] == ["help_start"]
