"""The documented distribution of tables agrees with the schema."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import compact_page
from eskin_cloud.store.schema.sealed_tables import removals
from eskin_cloud.store.schema.tables import blocks, channels, events, metadata, nodes, sequences
from eskin_cloud.store.schema.tile_tables import stale_chunks, tiles
from sqlalchemy import select, text

from eskin.wire.messages import Encoding
from tests.unit.cloud.brute_force import remove_before
from tests.unit.cloud.clouds import Clock, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, block, peak, status

if TYPE_CHECKING:
    from sqlalchemy import URL

    from eskin.wire.messages import Block
    from tests.support.postgresql import Cluster

PAGE: Final = (Path(__file__).parents[3] / "docs" / "storage.md").read_text()
CITUS, TIMESCALE = re.findall(
    r"```sql\n(.+?)```", PAGE.split("## Growing past one server")[1], re.DOTALL
)
STAYING: Final = re.search(r"^((?:`\w+`(?:,| and)?\s+)+)are\s+small and stay", PAGE, re.MULTILINE)

_LIKE_CITUS: Final = """
CREATE TABLE distributed (name text);
CREATE FUNCTION create_distributed_table(name regclass, by text) RETURNS void
LANGUAGE plpgsql AS $$ BEGIN
  IF EXISTS (
    SELECT FROM pg_index i JOIN pg_attribute a ON (a.attrelid, a.attname) = (i.indrelid, by)
    WHERE i.indrelid = name AND i.indisunique AND a.attnum <> ALL (i.indkey::int2[])
  ) THEN RAISE EXCEPTION '%: a unique key lacks %', name, by; END IF;
  INSERT INTO distributed VALUES (name::text);
END $$
"""
"""Refuses what Citus refuses: a unique key across shards."""


def by_node() -> set[str]:
    return {table.name for table in metadata.sorted_tables if "node" in table.columns}


def test_tables_of_nodes_are_keyed_by_node_first() -> None:
    for table in metadata.sorted_tables:
        if table.name in by_node():
            names = [column.name for column in table.primary_key.columns]
            assert names[: names.index("node")] in ([], ["slot"]), table.name
            assert not [index for index in table.indexes if index.unique], table.name
        assert not table.foreign_keys, table.name


def test_documented_distribution_takes_every_table_of_nodes_and_no_other(cluster: Cluster) -> None:
    place = cluster.fresh()
    cluster.execute(_LIKE_CITUS, database=str(place.database))
    cluster.execute(CITUS, database=str(place.database))
    with Store(place) as store, store.read() as connection:
        found = connection.execute(text("SELECT name FROM distributed")).scalars().all()
    assert sorted(found) == sorted(by_node())


def test_all_other_tables_are_documented_to_stay() -> None:
    assert STAYING is not None
    others = {table.name for table in metadata.sorted_tables} - by_node()
    assert set(re.findall(r"`(\w+)`", STAYING[1])) == others


def test_store_that_is_keyed_by_time_too_comes_to_hold_the_same(cluster: Cluster) -> None:
    usual, cut = cluster.fresh(), cluster.fresh()
    alter, hypertable = TIMESCALE.split(";\n")[:2]
    assert "create_hypertable('blocks', by_range('t'" in hypertable
    cluster.execute(alter, database=str(cut.database))
    expected = lived(usual)
    assert all(expected.values())
    assert lived(cut) == expected
    keys = "SELECT pg_get_constraintdef(oid) FROM pg_constraint WHERE conname = 'blocks_pkey'"
    with Store(cut) as store, store.read() as connection:
        assert connection.execute(text(keys)).scalar_one().endswith("(node, boot, sequence, t)")


def lived(place: URL) -> dict[str, list[dict[str, Any]]]:
    """What a store holds after blocks came late and twice, were built, packed and removed."""
    said = [told(number) for number in range(300)]
    with Store(place, clock=Clock(START)) as store:
        put(store, status(0), *said[:250:2], peak(1))
        build(store)
        put(store, *said[1:250:2], *said[:50])
        while compact_page(store, (NODE, CHANNEL), behind=0):
            pass
        put(store, *said, peak(1))
        remove_before(store, START + 20_000)
        build(store)
        put(store, told(7), told(8000, late=50_000))
        with store.read() as connection:
            return {
                table.name: [
                    dict(row) | {"mark": None}
                    for row in connection.execute(
                        select(table).order_by(*table.primary_key.columns)
                    ).mappings()
                ]
                for table in (
                    nodes,
                    channels,
                    blocks,
                    events,
                    sequences,
                    tiles,
                    stale_chunks,
                    removals,
                )
            }


def told(number: int, *, late: int | None = None) -> Block:
    """One of many blocks that follow each other, or a late one; 64 make a chunk."""
    at = START + (256 * number if late is None else late)
    level = float(number % 7)
    values = [level] * 256, [level + 1.0] * 256
    return block(10 + number, *values, time=(at, at), dt=1, encoding=Encoding.Q16)
