"""Memory that a rush of messages took goes back to the system."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import psutil
import pytest

import eskin.runtime.memory
from eskin.runtime.memory import MUCH, HeapTrimmer, freeze_gc, give_back

_LARGE = """
import ctypes, sys
from eskin.runtime.memory import keep_large_apart

class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in (
        "arena", "ordblks", "smblks", "hblks", "hblkhd",
        "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")]

info = ctypes.CDLL(None).mallinfo2
info.restype = Info
if sys.argv[1:]:
    keep_large_apart()
for _ in range(3):
    bytes(4_000_000)  # a large piece that is freed
before = info().hblkhd
large = bytes(1_000_000)
print(info().hblkhd - before)
"""


def test_memory_is_given_back_once_a_minute_where_much_came(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, given = [1000.0], []
    monkeypatch.setattr(eskin.runtime.memory, "give_back", lambda: given.append(now[0]))
    heap_trimmer = HeapTrimmer(lambda: now[0])
    assert not heap_trimmer.take(2 * MUCH)
    now[0] += 60.0
    assert heap_trimmer.take(0)
    now[0] += 60.0
    assert not heap_trimmer.take(MUCH - 1)
    assert heap_trimmer.take(1)
    now[0] += 30.0
    assert not heap_trimmer.take(MUCH)
    now[0] += 30.0
    assert heap_trimmer.take(0)
    assert given == [1060.0, 1120.0, 1180.0]


def test_what_lies_scattered_is_given_back() -> None:
    own = psutil.Process()
    scattered = [bytes(1000 + number % 500) for number in range(100_000)]
    kept = scattered[::50]
    del scattered
    before = own.memory_info().rss
    give_back()
    assert own.memory_info().rss < before - 50_000_000
    assert len(kept) == 2000


class Ring:
    """What refers to itself."""

    next: Ring


@pytest.mark.nightly
def test_what_is_there_once_settled_is_looked_at_no_more() -> None:
    there = [[number] for number in range(1000)]
    ring = Ring()
    ring.next = ring
    gone = weakref.ref(ring)
    gc.collect()
    del ring  # garbage that would be frozen with the rest
    before = gc.get_freeze_count()
    try:
        freeze_gc()
        assert gone() is None
        assert gc.get_freeze_count() > before + len(there)
        assert not any(each is there[0] for each in gc.get_objects())
    finally:
        gc.unfreeze()


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_large_pieces_come_from_the_system_also_after_others_were_freed() -> None:
    def taken(*how: str) -> int:
        stated = subprocess.run(
            [sys.executable, "-c", _LARGE, *how], capture_output=True, text=True, check=True
        )
        return int(stated.stdout)

    assert taken() == 0
    assert taken("apart") >= 1_000_000
