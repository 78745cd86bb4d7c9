"""A store of years: one channel of 1 kHz in packs of four blocks of 500, and its pyramid.

Packs repeat after a while, but for their places in time and in the feed; each is stored and indexed
as if it were new.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_cloud.rollup.tile_builder import AT_ONCE, claim, find_unclaimed, rebuild_stale
from eskin_cloud.store.compacted_rows import join_blocks
from eskin_cloud.store.damage import RowHeader
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.schema.tables import blocks, channels
from eskin_cloud.store.schema.tile_tables import stale_chunks
from eskin_cloud.store.write.block_row import BlockRow
from eskin_cloud.store.write.bulk_insert import insert_many
from sqlalchemy import func, select

from eskin.kernels.varints import LONGEST, read_varints, write_varints
from eskin.runtime.digest import digest
from eskin.wire.messages import BlockSummary, Encoding, decode_summary
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, block

if TYPE_CHECKING:
    from eskin_cloud.rollup.tile_builder import Key
    from eskin_cloud.store import Store
    from numpy.typing import NDArray
    from rich.progress import Progress

    Row = dict[str, Any]

DT: Final = 1_000_000
"""Between two samples, in ns."""
_BLOCKS: Final = 4
_SAMPLES: Final = 500
_SPAN: Final = _BLOCKS * _SAMPLES * DT
_PATTERNS: Final = 16
_BATCH: Final = 2000
_BENT: Final = 5
"""A pack says first of its blocks: sequences, cursors, ticks and both ends of their times."""


class LongStore:
    """A channel that grows, pack by pack.

    Args:
        store: An empty one, or one that grew like this before.
        screen: Shows how far it is.
    """

    def __init__(self, store: Store, screen: Progress) -> None:
        self._store, self._screen = store, screen
        random = np.random.default_rng(1)
        self._patterns = [_pattern(k, random) for k in range(_PATTERNS)]
        put(store, block(0, boot=2, dt=DT))
        with store.read() as connection:
            samples = find_channel(connection, NODE, CHANNEL)["samples"]
        self._packs = samples // (_BLOCKS * _SAMPLES)

    def grow(self, samples: int) -> None:
        """Write until it holds so many samples."""
        end = samples // (_BLOCKS * _SAMPLES)
        task = self._screen.add_task("packs written", total=end - self._packs)
        while self._packs < end:
            count = min(_BATCH, end - self._packs)
            self._store.write(partial(self._keep, count=count)).result()
            self._packs += count
            self._screen.advance(task, count)

    def build(self) -> None:
        """Build the pyramid over it, as the cloud does in the background."""
        for place in find_unclaimed(self._store):
            while claim(self._store, place):
                pass
        with self._store.read() as connection:
            total = connection.execute(select(func.count()).select_from(stale_chunks)).scalar_one()
        task = self._screen.add_task("chunks built", total=total)
        after: Key | None = None
        while (after := rebuild_stale(self._store, after)) is not None:
            self._screen.advance(task, AT_ONCE)

    def _keep(self, connection: Any, count: int) -> None:
        cache = self._store.cache
        rows = []
        for number in range(self._packs, self._packs + count):
            cursors = [cache.next_cursor(connection) for _ in range(_BLOCKS)]
            row, turn = self._patterns[number % _PATTERNS], number // _PATTERNS
            rows.append(_moved(row, turn * _PATTERNS, cursors[0]))
        insert_many(connection, blocks, rows)
        channel = cache.row(connection, channels, NODE, CHANNEL)
        assert channel is not None
        channel["blocks"] += count * _BLOCKS
        channel["samples"] += count * _BLOCKS * _SAMPLES
        channel["bytes"] += sum(len(row["data"]) for row in rows)
        channel["t_last"] = rows[-1]["t_end"]
        channel["packed"] = channel["t_last"] + 1
        channel["longest"] = _SPAN
        channel["lo"], channel["hi"] = -2.0, 2.0
        cache.change(channels, NODE, CHANNEL)


def _pattern(number: int, random: np.random.Generator) -> Row:
    """The row of a pack, its first cursor 0."""
    rows = []
    for k in range(number * _BLOCKS, (number + 1) * _BLOCKS):
        lo = np.sin(np.arange(_SAMPLES) / 50 + k) + random.normal(0, 0.01, _SAMPLES)
        t = START + k * _SAMPLES * DT
        said = block(k, lo, lo + 0.05, dt=DT, time=(t, t), encoding=Encoding.Q16).encode()
        summary = decode_summary(said)
        assert isinstance(summary, BlockSummary)
        row = BlockRow.of(NODE, summary, said, digest(said), k - number * _BLOCKS, START)
        rows.append(row._asdict())
    return join_blocks(rows)


def _moved(row: Row, packs: int, cursor: int) -> Row:
    """The same so many packs later, with another first cursor."""
    later, data = packs * _SPAN, row["data"]
    behind = 3 + int.from_bytes(data[1:3], "little")
    numbers = np.empty((_BENT, _BLOCKS), np.int64)
    rest = read_varints(data, behind, numbers.ravel())
    steps = np.array([packs * _BLOCKS, cursor, 0, later, later])
    numbers[:, 0] += steps
    numbers[:, 1] -= steps  # second differences
    moved = data[:behind] + _written(numbers) + data[rest:]
    times = {name: row[name] + later for name in ("t", "t_end", "t_lo", "t_hi")}
    place = {"sequence": row["sequence"] + packs * _BLOCKS, "cursor": cursor + _BLOCKS - 1}
    made = row | times | place | {"data": moved, "digest": digest(moved)}
    return made | {"head": RowHeader.of(made).checksum()}


def _written(numbers: NDArray[np.int64]) -> bytes:
    out = np.empty(numbers.size * LONGEST, np.uint8)
    return out[: write_varints(numbers.ravel(), out)].tobytes()
