"""A store of years: one channel, its frames compacted, and its pyramid.

Samples repeat after a while, but for their place in time. The first frames are stored and compacted
as the cloud does; the rows that this gives are then written again with later times and numbers, as
compaction would, without the frames. So a store of 1e9 samples takes minutes, not hours, and what is
read of it is the same.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.damage import PatchRowHeader
from eskin_cloud.store.disk_usage import measure_disk
from eskin_cloud.store.patch_rows import decode_runs, encode_runs
from eskin_cloud.store.patch_totals import add_rows
from eskin_cloud.store.schema.frame_tables import patch_rows
from eskin_cloud.store.write.bulk_insert import insert_many
from sqlalchemy import select

from eskin.runtime.digest import digest
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from eskin_cloud.store.patch_run import PatchRun
    from eskin_cloud.store.write.write_cache import Row
    from rich.progress import Progress
    from sqlalchemy import Connection

    from eskin.wire.frames import Frame

DT: Final = 1_000_000
"""Between two samples, in ns."""
SAMPLES: Final = 1000
"""Of a frame."""
_PATTERNS: Final = 64
_CYCLE: Final = 10 * _PATTERNS
"""Frames that are written as such; those after them have the same samples."""
_WIDTH: Final = 0.05
_DUE: Final = Due(2**62, 2**62)
"""Frames of any age are compacted."""


class _Compacted(NamedTuple):
    """A row of compacted frames, and its runs."""

    row: Row
    runs: list[PatchRun]


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
        """Write until it holds so many samples, all of them compacted; whole cycles of frames."""
        end = -(-samples // (SAMPLES * _CYCLE)) * _CYCLE
        task = self._screen.add_task("frames written", total=end - self._frames)
        if not self._frames:
            put(self._store, *map(self._frame, range(_CYCLE)))
            for page in find_compactable_frames(self._store, _DUE):
                while compact_frames(self._store, page, _DUE):
                    pass
            self._frames = _CYCLE
            self._screen.advance(task, _CYCLE)
        cycle = self._first_cycle() if self._frames < end else []
        while self._frames < end:
            rows = [self._later(each, self._frames) for each in cycle]
            self._store.write(lambda connection: self._insert(connection, rows)).result()  # noqa: B023
            self._frames += _CYCLE
            self._screen.advance(task, _CYCLE)

    def _first_cycle(self) -> list[_Compacted]:
        until = START + _CYCLE * SAMPLES * self._dt
        query = select(patch_rows).where(patch_rows.c.t < until).order_by(patch_rows.c.t)
        with self._store.read() as connection:
            rows = connection.execute(query).mappings().all()
        return [_Compacted(dict(row), decode_runs(row["data"])) for row in rows]

    def _later(self, compacted: _Compacted, frames: int) -> Row:
        """A row as it would be so many frames later."""
        row, later = compacted.row, frames * SAMPLES * self._dt
        runs = [
            run._replace(sequence=run.sequence + frames, ticks=run.ticks + later, t=run.t + later)
            for run in compacted.runs
        ]
        data = encode_runs(runs)
        times = {name: row[name] + later for name in ("t", "t_end")}
        new = row | times | {"sequence": row["sequence"] + frames}
        new |= {"data": data, "digest": digest(data)}
        return new | {"head": PatchRowHeader.of(new).checksum()}

    def _insert(self, connection: Connection, rows: list[Row]) -> None:
        insert_many(connection, patch_rows, rows)
        add_rows(connection, rows, self._dt)

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
