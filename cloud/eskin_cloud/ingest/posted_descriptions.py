"""Descriptions of frames, which a gateway presents: patches and layouts of its nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.wire.messages.cbor_map import MOST_BYTES, items, load_any, octets
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.descriptions import Description, read_description, store_description

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.store.write.write_cache import WriteCache

MOST: Final = 500


class Posted(NamedTuple):
    """One description that was presented.

    Attributes:
        node: Whose it is; empty where that cannot be read.
        description: What it is; ``None`` where it is refused.
        reason: Why it is refused.
    """

    node: str
    description: Description | None
    reason: str | None = None


class PostedResult(NamedTuple):
    """What became of one description.

    Attributes:
        result: ``stored``, ``duplicate``, ``rejected`` or ``unknown_node``.
        reason: Why it is not stored.
    """

    result: str
    reason: str | None = None


def read_posted(body: bytes) -> list[Posted]:
    """Read what a gateway presents: CBOR array of ``[node, plaintext]``.

    Raises:
        MalformedBatchError: It is no array of at most 500 items.
    """
    try:
        listed = items(load_any(body, "body"), "body", MOST)
    except MessageError as error:
        raise MalformedBatchError(f"{error}; send a CBOR array of [node, plaintext]") from error
    return [_read(each) for each in listed]


def store_posted(
    connection: Connection, cache: WriteCache, posted: Sequence[Posted], *, site: str
) -> list[PostedResult]:
    """Store descriptions within a transaction.

    Args:
        connection: The writer's.
        cache: The writer's.
        posted: As `read_posted` gives them.
        site: The gateway's site.

    Returns:
        What became of each, in its order.
    """
    sites = cache.sites(connection, {each.node for each in posted})
    return [_store(connection, each, known=sites.get(each.node) == site) for each in posted]


def _read(value: object) -> Posted:
    if not isinstance(value, list) or len(value) != 2 or not isinstance(value[0], str):
        return Posted("", None, "the item is no array of a node's name and bytes")
    try:
        IdentityKind.NODE.require_name(value[0])
    except IdentityError as error:
        return Posted("", None, str(error))
    try:
        data = octets(value[1], "the description", 1, MOST_BYTES)
        return Posted(value[0], read_description(data))
    except MessageError as error:
        return Posted(value[0], None, str(error))


def _store(connection: Connection, posted: Posted, *, known: bool) -> PostedResult:
    if posted.node and not known:
        return PostedResult(
            "unknown_node",
            "no certificate of this node is known for the gateway's site; present it",
        )
    if posted.description is None:
        return PostedResult("rejected", posted.reason)
    try:
        fresh = store_description(connection, posted.node, posted.description)
    except MessageError as error:
        return PostedResult("rejected", str(error))
    return PostedResult("stored" if fresh else "duplicate")
