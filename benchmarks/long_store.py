"""A store of years: one channel, its frames compacted, and its pyramid.

Samples repeat after a while, but for their place in time. The first frames are stored and compacted
as the cloud does. The rows that this gives, and the chunks of tiles, are then written again with
later times and numbers, as if all frames had come. So a store of 1e9 samples takes minutes, not
hours, and what is read of it is the same.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np
from eskin_cloud.rollup.column_aggregates import joined, pack
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.rollup.patch_tiles import fold_chunks
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.damage import PatchRowHeader
from eskin_cloud.store.disk_usage import measure_disk
from eskin_cloud.store.patch_rows import MOST_BYTES, compress, decompress
from eskin_cloud.store.patch_totals import Place, add_rows, save_built
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, TOP
from eskin_cloud.store.schema.frame_tables import patch_rows, patch_tiles, patches
from eskin_cloud.store.write.bulk_insert import insert_many
from sqlalchemy import select

from eskin.runtime.digest import digest
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.rollup.column_aggregates import ColumnAggregates
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.write_cache import Row
    from rich.progress import Progress
    from sqlalchemy import Connection

    from eskin.wire.frames import Frame

DT: Final = 2**20
"""Between two samples, in ns: so chunks repeat soon, too."""
SAMPLES: Final = 1000
"""Of a frame."""
_PATTERNS: Final = 64
_CYCLE: Final = 10 * _PATTERNS
"""Frames that are written as such; those after them have the same samples."""
_ROWS_AT_ONCE: Final = 500
_WIDTH: Final = 0.05
_DUE: Final = Due(2**62, 2**62)
"""Frames of any age are compacted."""


_HEADS: Final = 3
"""Where the heads of a row's runs are, differenced from run to run, in byte planes."""
_HEAD_PARTS: Final = 11


class _Compacted(NamedTuple):
    """A row of compacted frames, and its data as they are encoded."""

    row: Row
    content: dict[int, Any]


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
        return [
            _Compacted(dict(row), cbor2.loads(decompress(row["data"], MOST_BYTES))) for row in rows
        ]

    def _later(self, compacted: _Compacted, frames: int) -> Row:
        """A row as it would be so many frames later: its first run's number and ticks differ."""
        row, later = compacted.row, frames * SAMPLES * self._dt
        planes = np.frombuffer(compacted.content[_HEADS], np.uint8).reshape(8, -1)
        heads = planes.T.copy().view(np.int64).reshape(_HEAD_PARTS, -1)
        heads[1:3, 0] += (frames, later)
        planes = heads.view(np.uint8).reshape(-1, 8).T
        data = compress(cbor2.dumps(compacted.content | {_HEADS: planes.tobytes()}))
        new = row | {name: row[name] + later for name in ("t", "t_end")}
        new |= {"sequence": row["sequence"] + frames, "data": data, "digest": digest(data)}
        return new | {"head": PatchRowHeader.of(new).checksum()}

    def _insert(self, connection: Connection, rows: list[Row]) -> None:
        insert_many(connection, patch_rows, rows)
        add_rows(connection, rows, self._dt)

    def build(self) -> None:
        """Build the pyramid over it, as the cloud does in the background."""
        build(self._store)

    def repeat_tiles(self) -> None:
        """Build the same pyramid, but each chunk that repeats only once."""
        with self._store.read() as connection:
            (row,) = connection.execute(select(patches)).mappings()
        place, grain = Place(row["node"], row["patch"]), row["grain"]
        bits = grain + PATCH_CHUNK
        within = row["t_first"], row["t_last"] >> bits << bits
        made: dict[tuple[int, int], ColumnAggregates | None] = {}

        def fold(level: int, number: int) -> tuple[ColumnAggregates | None, int]:
            """A chunk, and by how much later than it is the wanted one."""
            wide = level + PATCH_CHUNK
            period = math.lcm(SAMPLES * _PATTERNS * self._dt, 1 << wide)
            begin, end = number << wide, (number + 1) << wide
            whole = within[0] <= begin and end <= within[1]
            key = level, begin % period if whole else begin - (1 << 63)
            if begin >= within[1] or end <= within[0]:
                return None, 0
            if key not in made:
                made[key] = self._fold(place, level, number, grain, fold)
                origin[key] = begin
            return made[key], begin - origin[key]

        origin: dict[tuple[int, int], int] = {}
        packed: dict[int, list[Any]] = {}
        for level in range(grain, TOP + 1, STEP):
            wide = level + PATCH_CHUNK
            numbers = range((within[0] >> bits << bits) >> wide, ((within[1] - 1) >> wide) + 1)
            for first in range(0, len(numbers), _ROWS_AT_ONCE):
                rows = []
                for number in numbers[first : first + _ROWS_AT_ONCE]:
                    chunk, later = fold(level, number)
                    if chunk is None or not len(chunk.pieces):
                        continue
                    if id(chunk) not in packed:
                        packed[id(chunk)] = cbor2.loads(decompress(pack(chunk), MOST_BYTES))
                    names, finest, heads, *rest = packed[id(chunk)]
                    shifted = np.frombuffer(heads, np.int64).reshape(8, -1).copy()
                    shifted[1] += later
                    data = compress(cbor2.dumps([names, finest, shifted.tobytes(), *rest]))
                    key = place.key | {"level": level, "chunk": number}
                    rows.append(key | {"data": data, "digest": digest(data)})
                self._store.write(lambda c: insert_many(c, patch_tiles, rows)).result()  # noqa: B023
        self._store.write(lambda c: save_built(c, place, within[1])).result()

    def _fold(
        self,
        place: Place,
        level: int,
        number: int,
        grain: int,
        fold: Callable[[int, int], tuple[ColumnAggregates | None, int]],
    ) -> ColumnAggregates | None:
        """A chunk, from rows or from those below it."""
        if level == grain:
            with self._store.read() as connection:
                return fold_chunks(connection, place, level, [number])[number]
        parts = []
        for child in range(number << STEP, (number + 1) << STEP):
            chunk, later = fold(level - STEP, child)
            if chunk is not None:
                pieces = replace(
                    chunk.pieces, first=chunk.pieces.first + later, last=chunk.pieces.last + later
                )
                parts.append(chunk._replace(pieces=pieces).grouped(level))
        return joined(parts) if parts else None

    def _frame(self, number: int) -> Frame:
        later = number * SAMPLES * self._dt
        time, place = (START + later, START + later), Position(1, number)
        return replace(self._patterns[number % _PATTERNS], position=place, ticks=later, time=time)


def _pattern(number: int, dt: int, random: np.random.Generator) -> Frame:
    phase = np.arange(number * SAMPLES, (number + 1) * SAMPLES) / 50
    lo = np.sin(phase) + random.normal(0, _WIDTH / 5, SAMPLES)
    return stretch(number, lo, lo + _WIDTH, dt=dt, finest=_WIDTH)
