"""The decorators of this package's kernels: ``links.jit``, the one import from outside."""

from links.jit import borrowed, cache_root, inlined, is_cold, kernel, unkept

__all__ = ["borrowed", "cache_root", "inlined", "is_cold", "kernel", "unkept"]
