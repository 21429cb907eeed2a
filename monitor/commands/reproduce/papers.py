"""The five papers, each found by its key and loaded when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final, cast

if TYPE_CHECKING:
    from monitor.commands.reproduce.study import Job, Paper, Result

__all__ = ["KEYS", "paper_of", "perform"]

KEYS: Final = ("wan2018", "wan2016", "lu2016", "wang2020", "samar2006")


def paper_of(key: str) -> Paper:
    """The paper of this key.

    Raises
    ------
    KeyError
        There is none.
    """
    if key not in KEYS:
        raise KeyError(key)
    return cast("Paper", import_module(f"monitor.commands.reproduce.{key}.paper").PAPER)


def perform(job: Job) -> Result:
    """Do a job: all that a worker, here or on a cluster, has to call."""
    return paper_of(job.paper).work(job)
