"""Choose the allocator, so that freed memory returns to the system."""

from __future__ import annotations

import pyarrow as pa

from eskin.runtime.memory import keep_large_apart


def use_one_allocator() -> None:
    """Allocate by the C library alone, large pieces apart.

    Arrow would use mimalloc, which keeps pages for each thread that ever used it; nothing that is
    given back now and then comes from there (`eskin.runtime.memory.give_back`).
    """
    keep_large_apart()
    pa.set_memory_pool(pa.system_memory_pool())
