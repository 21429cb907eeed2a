"""CRC-16/MCRF4XX in machine code, eight bytes at a time, and words at any address.

The checksum of a frame is the largest part of reading it. A byte table makes each step wait for the
one before; with eight tables (the byte table run on by 0 to 7 zero bytes) a whole word is folded in
at once, and only its first two bytes depend on what came before ("slicing by eight", M. Kounavis
and F. Berry, 2005). The words stand where the bytes of a stream put them, which numba's arrays
cannot say: two intrinsics load and store them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from links.jit import inlined
from links.mavlink.dialect import CRC_TABLE

__all__ = ["checksum", "load_word", "store_word"]


def _sliced() -> np.ndarray[Any, np.dtype[np.uint64]]:
    """(8, 256): row k is the effect of a byte that k more bytes follow."""
    table = np.zeros((8, 256), np.uint64)
    table[0] = CRC_TABLE
    for k in range(1, 8):
        before = table[k - 1]
        table[k] = (before >> np.uint64(8)) ^ table[0][before & np.uint64(0xFF)]
    return table.astype(np.uint64)


_intrinsic: Callable[[Any], Any] = intrinsic
_T = _sliced()
_SEED = np.uint64(0xFFFF)
_BYTE = np.uint64(0xFF)
_8, _16, _24, _32, _40, _48, _56 = (np.uint64(8 * k) for k in range(1, 8))


@_intrinsic
def load_word(typingctx: Any, data: Any, at: Any) -> Any:
    """Bytes ``data[at:at + 8]`` as one little-endian number; the caller answers for the bounds."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = _address(context, builder, signature, args)
        return builder.load(word, align=1)

    return types.uint64(data, types.intp), code


@_intrinsic
def store_word(typingctx: Any, data: Any, at: Any, word: Any) -> Any:
    """Put the number ``word`` into bytes ``data[at:at + 8]``; the caller answers for the bounds."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, signature, args), align=1)
        return context.get_dummy_value()

    return types.void(data, types.intp, types.uint64), code


def _address(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, args[0])
    word = context.get_value_type(types.uint64)
    return builder.bitcast(builder.gep(array.data, [args[1]]), word.as_pointer())


@inlined
def checksum(data: Any, at: int, end: int, extra: int) -> Any:
    """Checksum of ``data[at:end]`` and then the byte ``extra``.

    Parameters
    ----------
    data : (n,) uint8
        Never read beyond ``end``.
    """
    crc = _SEED
    while at + 8 <= end:
        w = load_word(data, at) ^ crc
        crc = (
            _T[7, w & _BYTE]
            ^ _T[6, (w >> _8) & _BYTE]
            ^ _T[5, (w >> _16) & _BYTE]
            ^ _T[4, (w >> _24) & _BYTE]
            ^ _T[3, (w >> _32) & _BYTE]
            ^ _T[2, (w >> _40) & _BYTE]
            ^ _T[1, (w >> _48) & _BYTE]
            ^ _T[0, w >> _56]
        )
        at += 8
    while at < end:
        crc = (crc >> _8) ^ _T[0, (crc ^ data[at]) & _BYTE]
        at += 1
    return (crc >> _8) ^ _T[0, (crc ^ np.uint64(extra)) & _BYTE]
