"""The body of an ingest: any CBOR, into a store."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import cbor2
from eskin_cloud.ingest.batch import read_batch
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store import Store
from eskin_cloud.store.damage import FrameHeader, require_intact
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.write.ingest import ingest
from eskin_cloud.store.write.write_cache import WriteCache
from sqlalchemy import select

from eskin.wire.slot import SLOTS
from tests.robustness.fuzz.mutations.trees import mutate_tree
from tests.robustness.fuzz.target import Target
from tests.unit.cloud import messages as said
from tests.unit.cloud import skins
from tests.unit.gateway.messages import result

if TYPE_CHECKING:
    from pathlib import Path

    from sqlalchemy import Connection

    from eskin.wire.frames import Frame, Statements
    from eskin.wire.messages import Message

_LONGEST = 4096
"""Bytes of a batch: some ten frames, and five times as many inputs a second as with seventy."""
_AT_ONCE = 500
"""Batches in one transaction, which is undone then: the store does not grow."""


def make(folder: Path) -> Target:
    """Only `MalformedBatchError`; each item gets its answer; what is stored is what was said."""
    stack = ExitStack()
    store = stack.enter_context(Store(folder / "store.sqlite", clock=lambda: said.START))
    opened = _Transaction(store)

    def check(data: bytes) -> None:
        try:
            items = read_batch(data)
        except MalformedBatchError:
            return
        connection, cache = opened.take(), opened.cache
        outcome = ingest(
            connection,
            cache,
            items,
            gateway="gateway.g1",
            now=said.START,
            dead_letters=100,
        )
        cache.save(connection)
        assert len(outcome.results) == len(items)
        for receipt in outcome.results:
            assert receipt.result in {"stored", "duplicate", "rejected", "unknown_layout"}
            refused = receipt.result in {"rejected", "unknown_layout"}
            assert (receipt.reason is not None) is refused
            assert bool(receipt.want) is (receipt.result == "unknown_layout")
        for entry in outcome.entries:
            if entry.frame is not None:
                found = connection.execute(select(frames).where(frames.c.cursor == entry.cursor))
                row = found.mappings().one()
                require_intact(FrameHeader, row)
                assert row["data"] == entry.frame

    one: list[Message] = [said.status(3), result(4, 1)]
    skins.describe(store, skins.HAND, *skins.PATCHES)
    placed: list[Frame | Statements] = [skins.frame(6), skins.frame(7, page=1), skins.statements(8)]
    batches = [[[said.NODE, message.encode()]] for message in (*one, *placed)]
    batches.append([item for batch in batches for item in batch])
    seeds = tuple(cbor2.dumps(batch) for batch in batches)
    return Target(seeds, mutate_tree, check, stack, longest=_LONGEST)


class _Transaction:
    """The writer's connection, begun anew after so many uses."""

    def __init__(self, store: Store) -> None:
        self.cache = WriteCache()
        self._store = store
        self._used = 0
        self._connection: Connection | None = None

    def take(self) -> Connection:
        if self._connection is None or self._used == _AT_ONCE:
            if self._connection is not None:
                self._connection.rollback()
                self.cache.clear()
            else:
                self._connection = self._store._writing.connect()
            self._used = 0
            self._connection.begin()
            self.cache.lock(self._connection, range(SLOTS))
        self._used += 1
        return self._connection
