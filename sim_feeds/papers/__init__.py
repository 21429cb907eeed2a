"""The simulated experiments of the five papers, as arrays, one module a paper or family."""

from __future__ import annotations
