"""Rows that hold several blocks as one pack, and the blocks' own rows again.

A pack's row is that of one longer block: its samples follow each other in even steps, and its
columns say of them what a block's columns say. So all that is asked of rows goes for packs, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from eskin.errors import StoreError
from eskin.runtime.digest import digest
from eskin.wire.messages.compacted_block import Kept, Pack, pack
from eskin.wire.messages.compression import decompress
from eskin.wire.messages.fast_decode import scan
from eskin_cloud.store.damage import Head, require_sound
from eskin_cloud.store.write.block_row import BlockRow

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sqlalchemy import RowMapping

    from eskin_cloud.store.write.write_cache import Row

_ALIKE: Final = ("node", "channel", "boot", "dt", "coverage")


def follows(before: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Whether a block may stand behind another one in a pack."""
    return (
        row["t"] == before["t_end"] + before["dt"]
        and row["sequence"] > before["sequence"]
        and all(row[name] == before[name] for name in _ALIKE)
    )


def join(rows: Sequence[Mapping[str, Any]]) -> Row:
    """The row of a pack of blocks, each of which `follows` the one before.

    Raises:
        MessageError: They are of a kind that is not packed.
        DamagedRowError: One is not as it was written.
    """
    for row in rows:
        require_sound(row)
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
    return made | {"head": Head.of(made).checksum()}


def part(row: Mapping[str, Any]) -> list[Row]:
    """The rows of a pack's blocks, as they were.

    Raises:
        DamagedRowError: The pack is not as it was written.
    """
    require_sound(row)
    rows = []
    for kept in Pack.read(row["data"]).blocks():
        said = scan(kept.data)
        if said is None:
            raise StoreError(f"a pack of {row['node']}/{row['channel']} holds what is no block")
        place = kept.cursor, kept.received
        made = BlockRow.of(row["node"], said, kept.data, digest(kept.data), *place)
        rows.append(made._asdict())
    return rows


def bytes_of(row: RowMapping) -> list[bytes]:
    """The blocks that a row holds, byte for byte.

    Raises:
        DamagedRowError: It is not as it was written.
    """
    require_sound(row)
    if row["packed"] is None:
        return [decompress(row["data"])]
    return [kept.data for kept in Pack.read(row["data"]).blocks()]
