"""The study of wan2018 VI-B: its runs (:mod:`.parametric_runs`) and their tables."""

from __future__ import annotations

from monitor.commands.reproduce.wan2018.parametric_runs import jobs, work
from monitor.commands.reproduce.wan2018.tables import blocks, claims, summary

__all__ = ["blocks", "claims", "jobs", "summary", "work"]
