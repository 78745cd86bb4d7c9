"""Totals of a patch's compacted rows, and which chunks of its tiles are stale.

Only the writer thread changes them, in the transaction that changes the rows.
"""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import and_, bindparam, delete, func, insert, select, text, update

from eskin.wire.slot import slot_of
from eskin_cloud.store.sample_grid import MOST_SPAN, PATCH_CHUNK, STEP, TOP, patch_level
from eskin_cloud.store.schema.frame_tables import patch_rows, patches, stale_patch_chunks
from eskin_cloud.store.schema.node_key import of_node

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import ColumnElement, Connection, RowMapping, Table

    from eskin_cloud.store.write.write_cache import Row

_MARK: Final = text(
    "INSERT INTO stale_patch_chunks (slot, node, patch, chunk, mark) "
    "VALUES (:slot, :node, :patch, :chunk, :mark) "
    "ON CONFLICT (slot, node, patch, chunk) DO UPDATE SET mark = excluded.mark"
)
_UPDATE: Final = update(patches).where(
    *(column == bindparam(f"at_{column.name}") for column in patches.primary_key.columns)
)


class Place(NamedTuple):
    """A patch of a node."""

    node: str
    patch: str

    def within(self, table: Table) -> ColumnElement[bool]:
        """Whether a row of a table is of this patch."""
        c = table.c
        return and_(of_node(table, self.node), c.patch == self.patch)

    @property
    def key(self) -> dict[str, Any]:
        """The columns that each key begins with."""
        return {"slot": slot_of(self.node), "node": self.node, "patch": self.patch}


def read_totals(connection: Connection, place: Place) -> RowMapping | None:
    """A patch's row."""
    return connection.execute(select(patches).where(place.within(patches))).mappings().first()


def add_rows(connection: Connection, rows: Sequence[Row], dt: int) -> None:
    """Add new rows of one patch to its totals, and mark the chunks that hold their samples.

    Args:
        connection: The writer's, in a transaction.
        rows: Rows of `patch_rows`.
        dt: Period of the first, ns.
    """
    place = Place(rows[0]["node"], rows[0]["patch"])
    old = read_totals(connection, place)
    latest = max(rows, key=lambda row: row["t_end"])
    first, last = min(row["t"] for row in rows), latest["t_end"]
    if old is None:
        new: Row = dict.fromkeys(("rows", "samples", "bytes", "longest"), 0)
        new |= {"t_first": None, "t_last": None, "grain": patch_level(dt), "built": None}
        new |= {"hash": latest["hash"]}
    else:
        new = {name: value for name, value in old.items() if name in _COUNTED}
    if new["t_last"] is None or last >= new["t_last"]:
        new["hash"] = latest["hash"]
    new["rows"] += len(rows)
    new["samples"] += sum(row["samples"] for row in rows)
    new["bytes"] += sum(len(row["data"]) for row in rows)
    new["t_first"] = min(first, first if new["t_first"] is None else new["t_first"])
    new["t_last"] = max(last, last if new["t_last"] is None else new["t_last"])
    new["longest"] = max(new["longest"], *(row["t_end"] - row["t"] for row in rows))
    if old is None:
        connection.execute(insert(patches), place.key | new)
    _save(connection, place, mark_rows(connection, place, new, rows))


def subtract_rows(connection: Connection, place: Place, rows: Sequence[RowMapping]) -> None:
    """Subtract deleted rows of a patch, and mark the chunks that held their samples.

    Args:
        connection: The writer's, in a transaction.
        place: The patch.
        rows: With ``t``, ``t_end``, ``samples`` and ``size``, the length of ``data``.
    """
    old = read_totals(connection, place)
    if old is None:
        return
    new = {name: value for name, value in old.items() if name in _COUNTED}
    new["rows"] -= len(rows)
    new["samples"] -= sum(row["samples"] for row in rows)
    new["bytes"] -= sum(row["size"] for row in rows)
    remaining = select(func.min(patch_rows.c.t)).where(place.within(patch_rows))
    new["t_first"] = connection.execute(remaining).scalar_one()
    if new["t_first"] is None:
        new["t_last"] = None
    _save(connection, place, mark_rows(connection, place, new, rows))


def save_built(connection: Connection, place: Place, built: int | None) -> None:
    """Set up to where tiles are built."""
    connection.execute(update(patches).where(place.within(patches)).values(built=built))


def mark_rows(
    connection: Connection, place: Place, totals: Row, rows: Iterable[Row | RowMapping]
) -> Row:
    """Mark built chunks that rows touch as stale; gives the patch's totals as they are then.

    Rows that touch many chunks reset all tiles, to longer ones: otherwise a node that samples each
    millisecond at first, and each hour later, would mark billions of chunks.
    """
    grain = fitting_grain(totals["grain"], rows)
    if grain > totals["grain"]:
        connection.execute(delete(stale_patch_chunks).where(place.within(stale_patch_chunks)))
        return totals | {"grain": grain, "built": None}
    if totals["built"] is None:
        return totals
    bits = grain + PATCH_CHUNK
    numbers = {
        chunk
        for row in rows
        for chunk in range(row["t"] >> bits, (row["t_end"] >> bits) + 1)
        if chunk << bits < totals["built"]
    }
    mark_chunks(connection, place, numbers)
    return totals


def fitting_grain(grain: int, rows: Iterable[Row | RowMapping]) -> int:
    """The least level, from a patch's on, of whose chunks each row touches few."""
    longest = max((row["t_end"] - row["t"] for row in rows), default=0)
    while longest >> (grain + PATCH_CHUNK) >= MOST_SPAN and grain + STEP <= TOP:
        grain += STEP
    return grain


def mark_chunks(connection: Connection, place: Place, numbers: Iterable[int]) -> None:
    """Mark chunks of the lowest level as stale."""
    marks = [place.key | {"chunk": n, "mark": secrets.randbits(62)} for n in sorted(numbers)]
    if marks:
        connection.execute(_MARK, marks)


_COUNTED: Final = frozenset(
    ("hash", "rows", "samples", "bytes", "t_first", "t_last", "longest", "grain", "built")
)


def _save(connection: Connection, place: Place, totals: Row) -> None:
    key = {f"at_{name}": value for name, value in place.key.items()}
    connection.execute(_UPDATE, totals | key)
