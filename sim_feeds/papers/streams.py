"""Random streams of one experiment's seed, so that noise does not change with the faults."""

from __future__ import annotations

from typing import Final

NOISE_STREAM: Final = 2
FAULT_STREAM: Final = 3
PROCESS_STREAM: Final = 4
INPUT_STREAM: Final = 5
