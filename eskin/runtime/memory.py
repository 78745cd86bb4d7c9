"""Return freed memory to the system."""

from __future__ import annotations

import ctypes
import gc
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

MUCH: Final = 8_388_608
"""Bytes taken in since the last time, for which it is worth while."""
_EVERY_S: Final = 60.0
_LARGE: Final = 131_072
_M_MMAP_THRESHOLD: Final = -3


def give_back() -> None:
    """Return what the allocator keeps for later use; does nothing where it cannot (musl, macOS).

    glibc keeps freed pieces in an arena for each thread, and gives back only the ends of them.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def keep_large_apart() -> None:
    """Have pieces of 128 KiB and more come from the system, and go back to it when they are freed.

    glibc begins so, but takes the first large piece that is freed for a sign that such ones come
    and go, and cuts the next ones from its arenas. There batches of a megabyte and pages of a cache
    leave holes for each other: every new load took more than the one before. Does nothing where
    the allocator is another.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGE)


def freeze_gc() -> None:
    """Exempt all present objects from garbage collection; call it after startup.

    Python looks for garbage in cycles among old objects only once a quarter as many came anew. With
    what the imports brought, hundreds of thousands, that takes minutes, in which it piles up, and
    then a look takes long. What is frozen is neither counted nor looked at.
    """
    gc.collect()
    gc.freeze()


class HeapTrimmer:
    """Trims the heap at most once a minute, after enough bytes came in.

    Freed memory of a burst is scattered over the heap and would stay with the process.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._taken = 0
        self._gave = clock()

    def take(self, size: int) -> bool:
        """So many bytes came and went; gives whether memory was given back."""
        self._taken += size
        if self._taken < MUCH or self._clock() - self._gave < _EVERY_S:
            return False
        give_back()
        self._taken, self._gave = 0, self._clock()
        return True
