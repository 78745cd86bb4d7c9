"""Keeping each channel's row: its unit, and sums over its blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from cloud.store.grid import grain_of
from cloud.store.schema import channels
from eskin.messages import BlockSummary, Peak, Status
from eskin.messages.head import Kind

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from cloud.store.ledger import Ledger, Row
    from eskin.messages import Summary
    from eskin.privacy import Veiled

UNKNOWN: Final = ""
"""The unit of a channel of which only sealed messages are known, until a status names it."""


def check_units(
    connection: Connection, ledger: Ledger, node: str, message: Summary | Veiled
) -> str | None:
    """Why a message cannot be stored beside what is there: its unit is another one."""
    for channel, unit in units(message):
        row = ledger.row(connection, channels, node, channel)
        if row is not None and row["unit"] not in {unit, UNKNOWN}:
            return (
                f"channel {channel} of {node} is in {row['unit']!r}, and this message says "
                f"{unit!r}; a channel keeps its unit, so give the new quantity a new name"
            )
    return None


def units(message: Summary | Veiled) -> list[tuple[str, str]]:
    """The channels that a message speaks of, with their units."""
    if isinstance(message, BlockSummary | Peak):
        return [(message.channel, message.unit)]
    if isinstance(message, Status):
        return [(info.channel, info.unit) for info in message.channels]
    return []


def declare(connection: Connection, ledger: Ledger, node: str, status: Status) -> None:
    """Make rows for the channels that a status names."""
    for info in status.channels:
        row = ledger.row(connection, channels, node, info.channel)
        if row is None:
            row = _fresh(node, info.channel, info.unit, info.coverage, info.dt)
            ledger.create(channels, (node, info.channel), row)
        elif row["unit"] == UNKNOWN:
            row |= {"unit": info.unit, "coverage": info.coverage, "dt": info.dt}
            ledger.change(channels, node, info.channel)


def add_block(
    connection: Connection, ledger: Ledger, node: str, block: BlockSummary, size: int
) -> None:
    """Add a block of so many bytes to its channel's sums; the least coverage is the channel's."""
    key = node, block.channel
    row = ledger.row(connection, channels, *key)
    if row is None:
        row = _fresh(node, block.channel, block.unit, block.coverage, block.dt)
        ledger.create(channels, key, row)
    first, span = block.first_moment, block.span
    lo, hi = block.bounds
    if row["blocks"] == 0:
        row |= {"t_first": first, "t_last": first + span, "lo": lo, "hi": hi}
        row |= {"coverage": block.coverage, "dt": block.dt}
    if row["grain"] is None:
        row["grain"] = grain_of(block.dt)
    if row["built"] is not None and first < row["built"]:
        ledger.outdate(row, first, first + span)
    if row["packed"] is not None:
        row["packed"] = min(row["packed"], first)
    row["blocks"] += 1
    row["samples"] += block.n
    row["bytes"] += size
    row["t_first"], row["t_last"] = min(row["t_first"], first), max(row["t_last"], first + span)
    row["longest"] = max(row["longest"], span)
    row["lo"], row["hi"] = min(row["lo"], lo), max(row["hi"], hi)
    row["coverage"], row["dt"] = min(row["coverage"], block.coverage), min(row["dt"], block.dt)
    ledger.change(channels, *key)


def add_veiled(connection: Connection, ledger: Ledger, node: str, message: Veiled) -> None:
    """Count a sealed block; of its samples nothing is known but the minutes."""
    key = node, message.channel
    row = ledger.row(connection, channels, *key)
    if row is None:
        row = _fresh(*key, UNKNOWN, 0.0, 1)
        ledger.create(channels, key, row)
    first, last = message.time
    row["blocks"] += message.kind is Kind.BLOCK
    row["t_first"] = first if row["t_first"] is None else min(row["t_first"], first)
    row["t_last"] = last if row["t_last"] is None else max(row["t_last"], last)
    ledger.change(channels, *key)


def _fresh(node: str, channel: str, unit: str, coverage: float, dt: int) -> Row:
    return {
        "node": node,
        "channel": channel,
        "unit": unit,
        "coverage": coverage,
        "dt": dt,
        "blocks": 0,
        "samples": 0,
        "t_first": None,
        "t_last": None,
        "longest": 0,
        "lo": None,
        "hi": None,
        "grain": None,
        "built": None,
        "packed": None,
        "bytes": 0,
    }
