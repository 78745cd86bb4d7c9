"""The documented distribution of tables agrees with the schema."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin_cloud.store import Store
from eskin_cloud.store.schema.tables import metadata
from sqlalchemy import text

if TYPE_CHECKING:
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


CENTRAL: Final = {"monitors"}
"""Name a node, which no row of theirs belongs to."""


def by_slot() -> set[str]:
    return {table.name for table in metadata.sorted_tables if "slot" in table.columns}


def test_keys_of_nodes_rows_begin_with_slot_and_node() -> None:
    for table in metadata.sorted_tables:
        names = [column.name for column in table.primary_key.columns]
        if "node" in table.columns and table.name not in CENTRAL:
            assert names[:2] == ["slot", "node"], table.name
        if table.name in by_slot():
            assert names[0] == "slot", table.name
            assert not [index for index in table.indexes if index.unique], table.name
        assert not table.foreign_keys, table.name


def test_documented_distribution_takes_every_table_with_slots_and_no_other(
    cluster: Cluster,
) -> None:
    place = cluster.fresh()
    cluster.execute(_LIKE_CITUS, database=str(place.database))
    cluster.execute(CITUS, database=str(place.database))
    with Store(place) as store, store.read() as connection:
        found = connection.execute(text("SELECT name FROM distributed")).scalars().all()
    assert sorted(found) == sorted(by_slot())


def test_all_other_tables_are_documented_to_stay() -> None:
    assert STAYING is not None
    others = {table.name for table in metadata.sorted_tables} - by_slot()
    assert set(re.findall(r"`(\w+)`", STAYING[1])) == others


def test_documented_hypertable_has_its_time_in_its_key() -> None:
    found = re.search(r"create_hypertable\('(\w+)', by_range\('(\w+)'", TIMESCALE)
    assert found is not None
    name, time = found.groups()
    assert time in metadata.tables[name].primary_key.columns
