"""Rows of channels: the unit, and totals over the blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.privacy import SealedMessage
from eskin.wire.messages import BlockSummary, Peak, Status
from eskin.wire.messages.header import Kind
from eskin_cloud.store.row_digests import empty_row
from eskin_cloud.store.sample_grid import SampleGrid, base_level
from eskin_cloud.store.schema.tables import channels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin.wire.messages import Summary
    from eskin_cloud.store.write.block_row import BlockRow
    from eskin_cloud.store.write.write_cache import Row, WriteCache

MOST_CHANNELS: Final = 20_000
"""Of a node: each costs a row that is never deleted, or a place in a description. A hand of 8,400
taxels has as many channels of each quantity."""
UNKNOWN: Final = ""
"""The unit of a channel with sealed messages only, until a status states it."""
_EMPTY: Final = empty_row(channels)


def check_channels(
    connection: Connection, cache: WriteCache, node: str, message: Summary | SealedMessage
) -> str | None:
    """Why a message's channels are rejected: another unit, or too many channels."""
    fresh = 0
    for channel, unit in channels_of(message):
        row = cache.row(connection, channels, node, channel)
        if row is None:
            fresh += 1
        elif unit is not None and row["unit"] not in {unit, UNKNOWN}:
            return (
                f"channel {channel} of {node} is in {row['unit']!r}, and this message states "
                f"{unit!r}; a channel keeps its unit; give the new quantity another name"
            )
    if fresh and cache.count_channels(connection, node) + fresh > MOST_CHANNELS:
        return (
            f"{node} would have more than {MOST_CHANNELS} channels with this message, which names "
            f"{fresh} new; reuse the names that it has, or use another node"
        )
    return None


def channels_of(message: Summary | SealedMessage) -> list[tuple[str, str | None]]:
    """The channels of a message, with their units; ``None`` for a sealed message."""
    if isinstance(message, SealedMessage):
        return [(message.channel, None)]
    if isinstance(message, BlockSummary | Peak):
        return [(message.channel, message.unit)]
    if isinstance(message, Status):
        return [(info.channel, info.unit) for info in message.channels]
    return []


def declare_channels(connection: Connection, cache: WriteCache, node: str, status: Status) -> None:
    """Create rows for the channels of a status."""
    for info in status.channels:
        row = cache.row(connection, channels, node, info.channel)
        if row is None:
            row = _new_channel(node, info.channel, info.unit, info.coverage, info.dt)
            cache.create(channels, (node, info.channel), row)
        elif row["unit"] == UNKNOWN:
            row |= {"unit": info.unit, "coverage": info.coverage, "dt": info.dt}
            cache.change(channels, node, info.channel)


def ensure_channel(
    connection: Connection, cache: WriteCache, node: str, block: BlockSummary
) -> Row:
    """The row of a block's channel; creates it if needed."""
    row = cache.row(connection, channels, node, block.channel)
    if row is None:
        row = _new_channel(node, block.channel, block.unit, block.coverage, block.dt)
        cache.create(channels, (node, block.channel), row)
    if row["grain"] is None:
        row["grain"] = base_level(block.dt)
    return row


def add_blocks(cache: WriteCache, row: Row, rows: Sequence[BlockRow]) -> None:
    """Add blocks to their channel's totals; its coverage is the least of its blocks.

    Args:
        cache: The writer's.
        row: The channel's row.
        rows: The blocks' rows.
    """
    first, last = min(each.t for each in rows), max(each.t_end for each in rows)
    lo, hi = min(each.lo for each in rows), max(each.hi for each in rows)
    coverage, dt = min(each.coverage for each in rows), min(each.dt for each in rows)
    if row["blocks"] == 0:
        row |= {"t_first": first, "t_last": last, "lo": lo, "hi": hi}
        row |= {"coverage": coverage, "dt": dt}
    if row["built"] is not None and first < row["built"]:
        for each in rows:
            cache.invalidate_tiles(row, SampleGrid(each.t, each.dt, each.n))
    if row["packed"] is not None:
        row["packed"] = min(row["packed"], first)
    row["blocks"] += len(rows)
    row["samples"] += sum(each.n for each in rows)
    row["bytes"] += sum(len(each.data) for each in rows)
    row["t_first"], row["t_last"] = min(row["t_first"], first), max(row["t_last"], last)
    row["longest"] = max(row["longest"], *(each.t_end - each.t for each in rows))
    row["lo"], row["hi"] = min(row["lo"], lo), max(row["hi"], hi)
    row["coverage"], row["dt"] = min(row["coverage"], coverage), min(row["dt"], dt)
    cache.change(channels, row["node"], row["channel"])


def add_sealed(
    connection: Connection, cache: WriteCache, node: str, message: SealedMessage
) -> None:
    """Count a sealed block or peak; only its minutes are known."""
    key = node, message.channel
    row = cache.row(connection, channels, *key)
    if row is None:
        row = _new_channel(*key, UNKNOWN, 0.0, 1)
        cache.create(channels, key, row)
    first, last = message.time
    row["blocks"] += message.kind is Kind.BLOCK
    row["t_first"] = first if row["t_first"] is None else min(row["t_first"], first)
    row["t_last"] = last if row["t_last"] is None else max(row["t_last"], last)
    cache.change(channels, *key)


def _new_channel(node: str, channel: str, unit: str, coverage: float, dt: int) -> Row:
    stated = {"node": node, "channel": channel, "unit": unit, "coverage": coverage, "dt": dt}
    return _EMPTY | stated | dict.fromkeys(("blocks", "samples", "longest", "bytes"), 0)
