"""Memory goes back to the system once it is free: arrays of a long log are large, and there are few of them."""

import contextlib
import ctypes
import sys

M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
LARGE = 1 << 17
"""Bytes; from this size on an array has pages of its own, which are returned as soon as it is gone."""


def keep_none_back() -> None:
    """Tells the allocator (that of glibc; others are left alone) not to keep large arrays for later."""
    with contextlib.suppress(OSError, AttributeError):
        if sys.platform.startswith("linux"):
            library = ctypes.CDLL(None)
            library.mallopt(M_MMAP_THRESHOLD, LARGE)
            library.mallopt(M_ARENA_MAX, 2)


def give_back() -> None:
    """Returns what is free now."""
    with contextlib.suppress(OSError, AttributeError):
        if sys.platform.startswith("linux"):
            ctypes.CDLL(None).malloc_trim(0)
