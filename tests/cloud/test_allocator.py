"""What the cloud frees goes back to the system, whoever asked for it."""

from __future__ import annotations

import subprocess
import sys

_FOLD = """
import sys
from concurrent.futures import ThreadPoolExecutor
import pyarrow as pa
from cloud.allocator import use_one_allocator

if sys.argv[1:]:
    use_one_allocator()
with ThreadPoolExecutor(4) as pool:
    for data in pool.map(lambda n: pa.compress(bytes(n), "zstd"), [50_000] * 40):
        assert pa.decompress(data, 50_000, "zstd").size == 50_000
print(pa.mimalloc_memory_pool().max_memory())
"""


def test_arrow_takes_its_memory_from_the_c_library() -> None:
    def taken(*how: str) -> int:
        command = [sys.executable, "-c", _FOLD, *how]
        told = subprocess.run(command, capture_output=True, text=True, check=True)
        return int(told.stdout)

    assert taken() > 0
    assert taken("tuned") == 0
