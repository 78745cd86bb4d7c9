"""What the cloud frees goes back to the system, whatever asked for it."""

from __future__ import annotations

import subprocess
import sys

_FOLD = """
import sys
from concurrent.futures import ThreadPoolExecutor
import pyarrow as pa
import eskin.runtime.memory
from eskin_cloud.jobs import heap_trim

apart = []
heap_trim.keep_large_apart = lambda: apart.append(eskin.runtime.memory.keep_large_apart())
if sys.argv[1:]:
    heap_trim.use_one_allocator()
with ThreadPoolExecutor(4) as pool:
    for data in pool.map(lambda n: pa.compress(bytes(n), "zstd"), [50_000] * 40):
        assert pa.decompress(data, 50_000, "zstd").size == 50_000
print(pa.mimalloc_memory_pool().max_memory(), len(apart))
"""


def test_arrow_takes_its_memory_from_the_c_library_and_large_pieces_are_apart() -> None:
    def taken(*how: str) -> tuple[int, ...]:
        command = [sys.executable, "-c", _FOLD, *how]
        stated = subprocess.run(command, capture_output=True, text=True, check=True)
        return tuple(map(int, stated.stdout.split()))

    pooled, apart = taken()
    assert pooled > 0
    assert apart == 0
    assert taken("tuned") == (0, 1)
