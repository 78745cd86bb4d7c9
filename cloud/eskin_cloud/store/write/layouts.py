"""Layouts: whether a node's messages may be read by one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import select, tuple_

from eskin.errors import MessageError
from eskin.wire.slot import key_of
from eskin_cloud.store.descriptions import (
    UnknownDescriptionError,
    find_layout,
    find_stated_layouts,
)
from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.schema.frame_tables import pages

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.store.descriptions import DescriptionKey, LayoutResult
    from eskin_cloud.store.write.write_cache import WriteCache

MOST_CHANNELS: Final = 20_000
"""Of a node: a hand of 8,400 taxels has as many channels of each quantity."""


def accept_layouts(
    connection: Connection, cache: WriteCache, named: Iterable[DescriptionKey]
) -> dict[DescriptionKey, LayoutResult]:
    """The layouts by which messages are read, in few statements.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        named: Nodes with the hashes of their layouts.

    Returns:
        Each layout, or the error: the node did not state all of it; or its patches do not fit it, a
        channel has another unit already, or the node would have too many channels.
    """
    accepted: dict[DescriptionKey, LayoutResult] = {}
    fresh: list[DescriptionKey] = []
    for node, name in named:
        if cache.is_accepted(node, name):
            accepted[node, name] = _find(connection, node, name)
        else:
            fresh.append((node, name))
    stated = find_stated_layouts(connection, fresh)
    used = _used_layouts(connection, list(dict.fromkeys(node for node, _ in fresh)))
    _read_units(connection, cache, used, stated)
    for (node, name), described in stated.items():
        accepted[node, name] = described
        if isinstance(described, Exception):
            continue
        units = cache.units(node) or {}
        if name not in used[node]:  # else it was accepted by an earlier process
            try:
                units = _acceptable_units(units, node, described)
            except MessageError as error:
                accepted[node, name] = error
                continue
        cache.accept(node, name, units)
    return accepted


def _find(connection: Connection, node: str, name: bytes) -> LayoutResult:
    try:
        return find_layout(connection, node, name)
    except (UnknownDescriptionError, MessageError) as error:
        return error


def _used_layouts(connection: Connection, nodes: Sequence[str]) -> dict[str, set[bytes]]:
    """The layouts of the frames that each node has stored."""
    p, used = pages.c, {node: set[bytes]() for node in nodes}
    for part in key_batches([key_of(node) for node in nodes]):
        query = select(p.node, p.layout).where(tuple_(p.slot, p.node).in_(part)).distinct()
        for node, layout in connection.execute(query):
            used[node].add(layout)
    return used


def _read_units(
    connection: Connection,
    cache: WriteCache,
    used: Mapping[str, AbstractSet[bytes]],
    stated: Mapping[DescriptionKey, LayoutResult],
) -> None:
    """Read the units of the channels in the layouts that nodes have used."""
    unread = {node: names for node, names in used.items() if cache.units(node) is None}
    named = {(node, name) for node, names in unread.items() for name in names}
    found = {**stated, **find_stated_layouts(connection, named - stated.keys())}
    for node, names in unread.items():
        units: dict[str, str] = {}
        for name in names:
            described = found[node, name]
            if not isinstance(described, Exception):  # else damaged, and reported
                units |= described.units
        cache.keep_units(node, units)


def _acceptable_units(
    known: Mapping[str, str], node: str, described: DescribedLayout
) -> dict[str, str]:
    """The units of a node's channels, with those of a new layout.

    Raises:
        MessageError: A channel has another unit already, or there are too many.
    """
    for channel, unit in described.units.items():
        own = known.get(channel, unit)
        if own != unit:
            raise MessageError(
                f"channel {channel} of {node} is in {own!r}, and its layout states {unit!r}; a "
                "channel keeps its unit; give the new quantity another name"
            )
    units = {**known, **described.units}
    if len(units) > MOST_CHANNELS:
        raise MessageError(
            f"{node} would have {len(units)} channels with this layout; at most {MOST_CHANNELS} "
            "are allowed; reuse the names that it has, or use another node"
        )
    return units
