"""The study of wan2018 VI-B: its runs (:mod:`.parametric_runs`), tables and claims."""

from __future__ import annotations

from monitor.commands.reproduce.wan2018.parametric_runs import jobs, work
from monitor.commands.reproduce.wan2018.tables import blocks
from monitor.commands.reproduce.wan2018.verdicts import claims, summary

__all__ = ["blocks", "claims", "jobs", "summary", "work"]
