"""Convert rows of blocks to rows of packs, and back.

A pack's row looks like that of one longer block, so queries treat both alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from eskin.errors import StoreError
from eskin.runtime.digest import digest
from eskin.wire.messages.compacted_block import Kept, Pack, pack
from eskin.wire.messages.compression import decompress
from eskin.wire.messages.fast_decode import scan
from eskin_cloud.store.damage import RowHeader, require_intact
from eskin_cloud.store.write.block_row import BlockRow

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sqlalchemy import RowMapping

    from eskin_cloud.store.write.write_cache import Row

_ALIKE: Final = ("node", "channel", "boot", "dt", "coverage")


def follows(before: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Whether a block may follow another one in a pack."""
    return (
        row["t"] == before["t_end"] + before["dt"]
        and row["sequence"] > before["sequence"]
        and all(row[name] == before[name] for name in _ALIKE)
    )


def join_blocks(rows: Sequence[Mapping[str, Any]]) -> Row:
    """The row of a pack of blocks, each of which `follows` the one before.

    Raises:
        MessageError: The blocks are of a kind that is not compacted.
        DamagedRowError: A block is damaged.
    """
    for row in rows:
        require_intact(RowHeader, row)
    first = rows[0]
    data = pack([Kept(row["data"], row["cursor"], row["received"]) for row in rows])
    made = dict(first) | {
        "cursor": max(row["cursor"] for row in rows),
        "t_end": rows[-1]["t_end"],
        "error": max(row["error"] for row in rows),
        "n": sum(row["n"] for row in rows),
        "lo": min(row["lo"] for row in rows),
        "hi": max(row["hi"] for row in rows),
        "received": max(row["received"] for row in rows),
        "data": data,
        "digest": digest(data),
        "packed": len(rows),
    }
    return made | {"head": RowHeader.of(made).checksum()}


def split_blocks(row: Mapping[str, Any]) -> list[Row]:
    """The original rows of a pack's blocks.

    Raises:
        DamagedRowError: The pack is damaged.
    """
    require_intact(RowHeader, row)
    rows = []
    for kept in Pack.read(row["data"]).blocks():
        block = scan(kept.data)
        if block is None:
            raise StoreError(f"a pack of {row['node']}/{row['channel']} holds an invalid block")
        place = kept.cursor, kept.received
        made = BlockRow.of(row["node"], block, kept.data, digest(kept.data), *place)
        rows.append(made._asdict())
    return rows


def block_bytes(row: RowMapping) -> list[bytes]:
    """The blocks of a row, byte for byte.

    Raises:
        DamagedRowError: The row is damaged.
    """
    require_intact(RowHeader, row)
    if row["packed"] is None:
        return [decompress(row["data"])]
    return [kept.data for kept in Pack.read(row["data"]).blocks()]
