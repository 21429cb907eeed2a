"""CRC-16/MCRF4XX in machine code, sixteen bytes at a time.

The checksum of a frame is the largest part of reading it. A byte table makes each step wait for the
one before; with a table for each place (the byte table run on by 0 to 15 zero bytes) two words are
folded in at once, and only their first two bytes depend on what came before ("slicing by eight",
M. Kounavis and F. Berry, 2005, here by sixteen). What a frame's length leaves over is folded in
first, as a word with zeros before it, which leave a checksum of zero as it is: so a frame takes a
few steps of one kind, and no loop over single bytes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from links.jit import inlined
from links.mavlink.dialect import CRC_TABLE
from links.memory import load_word

__all__ = ["checksum"]

_STEP = 16


def _sliced() -> np.ndarray[Any, np.dtype[np.uint16]]:
    """(16, 256): row k is the effect of a byte that k more bytes follow."""
    table = np.zeros((_STEP, 256), np.uint16)
    table[0] = CRC_TABLE
    for k in range(1, _STEP):
        before = table[k - 1]
        table[k] = (before >> 8) ^ table[0][before & 0xFF]
    return table


_T = _sliced()
_SEED = np.uint64(0xFFFF)
_BYTE = np.uint64(0xFF)
_8, _16, _24, _32, _40, _48, _56 = (np.uint64(8 * k) for k in range(1, 8))


@inlined
def _fold(w: Any, after: int) -> Any:
    """Effect of the eight bytes of a word that ``after`` more bytes follow."""
    return (
        _T[after + 7, w & _BYTE]
        ^ _T[after + 6, (w >> _8) & _BYTE]
        ^ _T[after + 5, (w >> _16) & _BYTE]
        ^ _T[after + 4, (w >> _24) & _BYTE]
        ^ _T[after + 3, (w >> _32) & _BYTE]
        ^ _T[after + 2, (w >> _40) & _BYTE]
        ^ _T[after + 1, (w >> _48) & _BYTE]
        ^ _T[after, w >> _56]
    )


@inlined
def checksum(data: Any, at: int, end: int, extra: int) -> Any:
    """Checksum of ``data[at:end]`` and then the byte ``extra``.

    Parameters
    ----------
    data : (n,) uint8
        Never read beyond ``end``.
    """
    crc = _SEED
    size = end - at
    if size >= 8:
        over = ((size - 1) & 7) + 1  # 1 to 8 bytes, then whole words
        crc = np.uint64(_fold((load_word(data, at) ^ _SEED) << np.uint64(8 * (8 - over)), 0))
        if over == 1:
            crc ^= _SEED >> _8  # its second byte meets the next byte only
        at += over
        if (end - at) & 8:
            crc = np.uint64(_fold(load_word(data, at) ^ crc, 0))
            at += 8
        while at < end:
            w = load_word(data, at) ^ crc
            crc = np.uint64(_fold(w, 8) ^ _fold(load_word(data, at + 8), 0))
            at += _STEP
    else:
        while at < end:
            crc = (crc >> _8) ^ np.uint64(_T[0, (crc ^ np.uint64(data[at])) & _BYTE])
            at += 1
    return (crc >> _8) ^ np.uint64(_T[0, (crc ^ np.uint64(extra)) & _BYTE])
