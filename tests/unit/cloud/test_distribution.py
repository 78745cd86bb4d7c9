"""Keys of the schema are such that its tables can be distributed, and partitioned by time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from eskin_cloud.store.schema.tables import metadata

PAGE: Final = (Path(__file__).parents[3] / "docs" / "storage.md").read_text()
(TIMESCALE,) = re.findall(
    r"```sql\n(.+?)```", PAGE.split("## Growing past one server")[1], re.DOTALL
)

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


def test_documented_hypertable_has_its_time_in_its_key() -> None:
    found = re.search(r"create_hypertable\('(\w+)', by_range\('(\w+)'", TIMESCALE)
    assert found is not None
    name, time = found.groups()
    assert time in metadata.tables[name].primary_key.columns
