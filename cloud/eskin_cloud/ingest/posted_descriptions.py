"""Descriptions of frames, which a gateway presents: patches and layouts of its nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.wire.frames import content_hash
from eskin.wire.messages.cbor_map import MOST_BYTES, items, load_any, octets
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.descriptions import (
    MOST_DESCRIPTIONS,
    Description,
    read_description,
    refuse_description,
    store_descriptions,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.store.write.write_cache import WriteCache

MOST: Final = 500


class Posted(NamedTuple):
    """One description that was presented.

    Attributes:
        node: Whose it is; empty where that cannot be read.
        description: What it is; without data if it is refused, ``None`` if it cannot be read.
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
    results = [_judge(each, known=sites.get(each.node) == site) for each in posted]
    of_nodes: dict[str, dict[int, Description]] = {}
    for number, (each, result) in enumerate(zip(posted, results, strict=True)):
        if result is None and each.description is not None:
            of_nodes.setdefault(each.node, {})[number] = each.description
    for node, some in of_nodes.items():
        stored = _store(connection, node, list(some.values()))
        for number, result in zip(some, stored, strict=True):
            results[number] = result
    return [each for each in results if each is not None]


def _read(value: object) -> Posted:
    if not isinstance(value, list) or len(value) != 2 or not isinstance(value[0], str):
        return Posted("", None, "the item is no array of a node's name and bytes")
    try:
        IdentityKind.NODE.require_name(value[0])
    except IdentityError as error:
        return Posted("", None, str(error))
    try:
        data = octets(value[1], "the description", 1, MOST_BYTES)
    except MessageError as error:
        return Posted(value[0], None, str(error))
    try:
        return Posted(value[0], read_description(data))
    except MessageError as error:
        return Posted(value[0], Description("", content_hash(data), b""), str(error))


def _judge(posted: Posted, *, known: bool) -> PostedResult | None:
    """What becomes of a description without looking for it; ``None`` if it may be stored."""
    if posted.node and not known:
        return PostedResult(
            "unknown_node",
            "no certificate of this node is known for the gateway's site; present it",
        )
    if posted.reason is None:
        return None
    if posted.description is not None:
        refuse_description(posted.node, posted.description.hash, posted.reason)
    return PostedResult("rejected", posted.reason)


def _store(connection: Connection, node: str, some: Sequence[Description]) -> list[PostedResult]:
    results = []
    for each, result in zip(some, store_descriptions(connection, node, some), strict=True):
        reason = None
        if result == "rejected":
            reason = f"{node} has {MOST_DESCRIPTIONS} descriptions; use these, or another node"
            refuse_description(node, each.hash, reason)
        results.append(PostedResult(result, reason))
    return results
