"""A store of years: one channel, its frames compacted, and its pyramid.

Samples repeat after a while, but for their place in time; each frame is stored and compacted as if
it were new.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.disk_usage import measure_disk

from eskin.wire.messages import Position
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from rich.progress import Progress

    from eskin.wire.frames import Frame

DT: Final = 1_000_000
"""Between two samples, in ns."""
SAMPLES: Final = 1000
"""Of a frame."""
_PATTERNS: Final = 64
_AT_ONCE: Final = 500
_WIDTH: Final = 0.05
_DUE: Final = Due(2**62, 2**62)
"""Frames of any age are compacted."""


class LongStore:
    """A channel that grows, frame by frame.

    Args:
        store: An empty one, or one that grew like this before.
        screen: Shows how far it is.
        dt: Between two samples, in ns.
    """

    def __init__(self, store: Store, screen: Progress, *, dt: int = DT) -> None:
        self._store, self._screen, self._dt = store, screen, dt
        random = np.random.default_rng(1)
        self._patterns = [_pattern(number, dt, random) for number in range(_PATTERNS)]
        self._frames = int(measure_disk(store).samples) // SAMPLES

    def grow(self, samples: int) -> None:
        """Write until it holds so many samples, all of them compacted."""
        end = samples // SAMPLES
        task = self._screen.add_task("frames written", total=end - self._frames)
        while self._frames < end:
            numbers = range(self._frames, min(self._frames + _AT_ONCE, end))
            put(self._store, *map(self._frame, numbers))
            self._frames = numbers.stop
            self._screen.advance(task, len(numbers))
            for page in find_compactable_frames(self._store, _DUE):
                while compact_frames(self._store, page, _DUE):
                    pass

    def build(self) -> None:
        """Build the pyramid over it, as the cloud does in the background."""
        build(self._store)

    def _frame(self, number: int) -> Frame:
        later = number * SAMPLES * self._dt
        time, place = (START + later, START + later), Position(1, number)
        return replace(self._patterns[number % _PATTERNS], position=place, ticks=later, time=time)


def _pattern(number: int, dt: int, random: np.random.Generator) -> Frame:
    phase = np.arange(number * SAMPLES, (number + 1) * SAMPLES) / 50
    lo = np.sin(phase) + random.normal(0, _WIDTH / 5, SAMPLES)
    return stretch(number, lo, lo + _WIDTH, dt=dt, finest=_WIDTH)
