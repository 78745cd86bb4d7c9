"""Rows of pages: totals over the frames of each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.store.row_digests import empty_row
from eskin_cloud.store.schema.frame_tables import pages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.store.frame_row import FrameRow
    from eskin_cloud.store.write.write_cache import Key, WriteCache


def page_key(row: FrameRow) -> Key:
    """The key of a frame's page."""
    return row.slot, row.node, row.layout, row.page


def add_frames(connection: Connection, cache: WriteCache, rows: Sequence[FrameRow]) -> None:
    """Add frames of one page to its totals.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        rows: The frames' rows.
    """
    key = page_key(rows[0])
    first, last = min(each.t for each in rows), max(each.t_end for each in rows)
    row = cache.row(connection, pages, *key)
    if row is None:
        names = (column.name for column in pages.primary_key.columns)
        row = empty_row(pages) | dict(zip(names, key, strict=True))
        row |= dict.fromkeys(("frames", "samples", "bytes", "longest"), 0)
        cache.create(pages, key, row)
    if row["t_first"] is None:
        row |= {"t_first": first, "t_last": last}
    if row["compacted"] is not None:
        row["compacted"] = min(row["compacted"], first)
    row["frames"] += len(rows)
    row["samples"] += sum(each.samples for each in rows)
    row["bytes"] += sum(len(each.data) for each in rows)
    row["t_first"], row["t_last"] = min(row["t_first"], first), max(row["t_last"], last)
    row["longest"] = max(row["longest"], *(each.t_end - each.t for each in rows))
    cache.change(pages, *key)
