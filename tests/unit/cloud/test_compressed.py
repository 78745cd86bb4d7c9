"""Blocks are stored compressed; answers do not change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.live.feed import read_entries
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.compacted_rows import block_bytes
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.tables import blocks, channels
from eskin_cloud.store.write.parsed_message import ParsedMessage
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select

from eskin.runtime.digest import digest
from eskin.wire.messages import Encoding
from eskin.wire.messages.compression import is_compressed
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import NODE, START, block
from tests.unit.cloud.test_compaction import SPAN, answers, exported, said

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.wire.messages import Block

MANY = 30


def sent() -> list[Block]:
    return [said(number, encoding=Encoding.F32) for number in range(MANY)]


def plainly(messages: list[Block]) -> list[ParsedMessage]:
    """Messages without compression."""
    items = ParsedMessage.parse_all([(NODE, each.encode()) for each in messages])
    return [item._replace(compressed=None, digest=digest(item.data)) for item in items]


def store_compressed(store: Store) -> list[bytes]:
    messages = [each.encode() for each in sent()]
    put_items(store, ParsedMessage.parse_all([(NODE, data) for data in messages]))
    return messages


def test_stored_blocks_are_shorter_and_give_the_same_bytes(store: Store) -> None:
    messages = store_compressed(store)
    with store.read() as connection:
        rows = connection.execute(select(blocks).order_by(blocks.c.cursor)).mappings().all()
        told = connection.execute(select(channels.c.bytes)).scalar_one()
        size = connection.execute(select(func.sum(func.length(blocks.c.data)))).scalar_one()
    assert all(is_compressed(row["data"]) for row in rows)
    assert [data for row in rows for data in block_bytes(row)] == messages
    assert told == size < sum(map(len, messages))


def test_feed_resumes_with_the_received_bytes(store: Store) -> None:
    messages = store_compressed(store)
    with store.read() as connection:
        entries = read_entries(connection, 0, MANY)
    assert [entry.block for entry in entries] == messages


@given(window=st.tuples(st.integers(-1, MANY), st.integers(0, 99), st.integers(1, MANY * SPAN)))
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_compression_changes_no_answer(
    store: Store, tmp_path: Path, window: tuple[int, int, int]
) -> None:
    number, sample, length = window
    first = START + number * SPAN + sample * SPAN // 100
    asked = Window(first, first + length)
    with Store(tmp_path / f"{number}-{sample}-{length}.sqlite") as plain:
        put_items(plain, plainly(sent()))
        store_compressed(store)
        for each in (store, plain):
            build(each)
        assert repr(answers(store, asked)) == repr(answers(plain, asked))
        assert exported(store, asked, None, 300) == exported(plain, asked, None, 300)


def test_plain_blocks_of_before_stay_readable_beside_compressed_ones(store: Store) -> None:
    early = [said(number, late=7, encoding=Encoding.F32) for number in range(MANY)]
    put_items(store, plainly(early))
    messages = store_compressed(store)
    whole = Window(START - SPAN, START + (MANY + 1) * SPAN)
    found = exported(store, whole, None, 10**6)
    assert sorted(found) == sorted([*messages, *(each.encode() for each in early)])


def test_incompressible_blocks_are_stored_as_received(store: Store) -> None:
    wild = np.random.default_rng(1).choice([-3e38, 3e38, 1e-40], 100)
    messages = [block(0, [1.0], [2.0], encoding=Encoding.F32), block(1, wild, wild + abs(wild))]
    put_items(store, ParsedMessage.parse_all([(NODE, each.encode()) for each in messages]))
    with store.read() as connection:
        rows = connection.execute(select(blocks.c.data).order_by(blocks.c.sequence)).scalars()
        assert [bytes(data) for data in rows] == [each.encode() for each in messages]
