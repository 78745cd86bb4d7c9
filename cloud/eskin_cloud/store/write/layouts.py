"""Layouts: whether a node's messages may be read by one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import select

from eskin.errors import MessageError
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout, require_stated
from eskin_cloud.store.schema.frame_tables import pages
from eskin_cloud.store.slot import slot_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection

    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.store.write.write_cache import WriteCache

MOST_CHANNELS: Final = 20_000
"""Of a node: a hand of 8,400 taxels has as many channels of each quantity."""


def layout_of(connection: Connection, cache: WriteCache, node: str, name: bytes) -> DescribedLayout:
    """The layout by which a node's messages are read.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        node: The node.
        name: The layout's hash.

    Raises:
        UnknownDescriptionError: The node did not state it, or one of its patches.
        MessageError: The patches do not fit it, a channel has another unit already, or the node
            would have too many channels.
    """
    described = find_layout(connection, node, name)
    if not cache.is_accepted(node, name):
        require_stated(connection, node, described)
        cache.accept(node, name, _acceptable_units(connection, cache, node, described))
    return described


def _acceptable_units(
    connection: Connection, cache: WriteCache, node: str, described: DescribedLayout
) -> dict[str, str]:
    """The units of the channels in all layouts of a node, with a new one.

    Raises:
        MessageError: A channel has another unit already, or there are too many.
    """
    used = _used_layouts(connection, node)
    known = cache.units.get(node)
    if known is None:
        known = _units_of(connection, node, used)
    if described.hash in used:  # accepted by an earlier process
        return known
    for channel, unit in described.units.items():
        own = known.get(channel, unit)
        if own != unit:
            raise MessageError(
                f"channel {channel} of {node} is in {own!r}, and its layout states {unit!r}; a "
                "channel keeps its unit; give the new quantity another name"
            )
    units = known | described.units
    if len(units) > MOST_CHANNELS:
        raise MessageError(
            f"{node} would have {len(units)} channels with this layout; at most {MOST_CHANNELS} "
            "are allowed; reuse the names that it has, or use another node"
        )
    return units


def _used_layouts(connection: Connection, node: str) -> set[bytes]:
    """The layouts of the frames that a node has stored."""
    p = pages.c
    query = select(p.layout).where(p.slot == slot_of(node), p.node == node).distinct()
    return set(connection.execute(query).scalars())


def _units_of(connection: Connection, node: str, layouts: Iterable[bytes]) -> dict[str, str]:
    """The units of the channels in layouts."""
    units: dict[str, str] = {}
    for name in layouts:
        try:
            units |= find_layout(connection, node, name).units
        except UnknownDescriptionError:  # damaged, and reported
            continue
    return units
