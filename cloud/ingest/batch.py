"""A batch: CBOR array of ``[node, plaintext]``."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

import cbor2

from cloud.ingest.errors import MalformedBatchError
from cloud.store.item import WITHHELD, Item
from eskin.errors import MessageError
from eskin.messages.fields import MOST_BYTES, load_any

if TYPE_CHECKING:
    from collections.abc import Sequence

log = logging.getLogger(__name__)

MOST_ITEMS: Final = 10_000


def read_batch(body: bytes) -> Sequence[Item]:
    """Read a batch; a poor item harms none but itself.

    Raises:
        MalformedBatchError: It is no array of at most 10000 items.
    """
    try:
        listed = load_any(body, "body")
    except MessageError as error:
        raise MalformedBatchError(f"{error}; send a CBOR array of [node, plaintext]") from error
    if not isinstance(listed, list):
        raise MalformedBatchError("the body is no CBOR array of [node, plaintext]")
    if len(listed) > MOST_ITEMS:
        raise MalformedBatchError(
            f"the batch has {len(listed)} items; at most {MOST_ITEMS} are allowed"
        )
    said = [_said(value) for value in listed]
    items = iter(_read([each for each in said if not isinstance(each, Item)]))
    return [each if isinstance(each, Item) else next(items) for each in said]


def _said(value: object) -> tuple[str, bytes] | Item:
    """A node and what it said; an item where that is not what stands there."""
    if isinstance(value, list) and len(value) == 2:
        node, data = value
        if isinstance(node, str) and isinstance(data, bytes):
            if len(data) > MOST_BYTES:
                reason = f"message of over {MOST_BYTES} bytes"
                return Item.unread(node, data, reason)
            return node, data
    reason = "the item is no array of a node's name and bytes"
    return Item.unread("", cbor2.dumps(value), reason)


def _read(said: Sequence[tuple[str, bytes]]) -> Sequence[Item]:
    """Read messages; else one that breaks what reads it would be brought for ever."""
    try:
        return Item.read_all(said)
    except MemoryError:  # which is ours, and no message's
        raise
    except Exception as error:
        if len(said) > 1:
            return [item for each in said for item in _read([each])]
        node, data = said[0]
        log.exception("message broke what reads it: bytes=%d", len(data))
        reason = f"it broke what reads it: {type(error).__name__}"
        return [Item.refused(node, b"", reason + WITHHELD.format(len(data)))]
