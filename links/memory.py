"""Words and runs of bytes at any address, for kernels.

A stream of frames puts numbers where its bytes end up, which numba's arrays cannot say, and copying
slice by slice costs more than the bytes. These intrinsics are the machine's own instructions; none
looks at bounds, for which the caller answers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["copy_bytes", "load_word", "store_word"]

_intrinsic: Callable[[Any], Any] = intrinsic
_memcpy: Callable[..., Any] = cgutils.raw_memcpy


@_intrinsic
def load_word(typingctx: Any, data: Any, at: Any) -> Any:
    """Bytes ``data[at:at + 8]`` as one little-endian number."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = context.get_value_type(types.uint64).as_pointer()
        place = _address(context, builder, signature.args[0], args[0], args[1])
        return builder.load(builder.bitcast(place, word), align=1)

    return types.uint64(data, types.intp), code


@_intrinsic
def store_word(typingctx: Any, data: Any, at: Any, word: Any) -> Any:
    """Put the number ``word`` into bytes ``data[at:at + 8]``, little-endian."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = context.get_value_type(types.uint64).as_pointer()
        place = _address(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], builder.bitcast(place, word), align=1)
        return context.get_dummy_value()

    return types.void(data, types.intp, types.uint64), code


@_intrinsic
def copy_bytes(typingctx: Any, data: Any, at: Any, to_data: Any, to: Any, size: Any) -> Any:
    """Copy ``data[at:at + size]`` to ``to_data[to:to + size]``; the two must not overlap."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        source = _address(context, builder, signature.args[0], args[0], args[1])
        target = _address(context, builder, signature.args[2], args[2], args[3])
        _memcpy(builder, target, source, args[4], 1)
        return context.get_dummy_value()

    return types.void(data, types.intp, to_data, types.intp, types.intp), code


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    return builder.gep(context.make_array(kind)(context, builder, array).data, [at])
