"""A batch: CBOR array of ``[node, plaintext]``."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

import cbor2

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import MOST_BYTES, load_any
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.write.parsed_message import WITHHELD, ParsedMessage

if TYPE_CHECKING:
    from collections.abc import Sequence

log = logging.getLogger(__name__)

MOST_ITEMS: Final = 10_000
_NO_ITEM: Final = "the item is no array of a node's name and bytes"


def read_batch(body: bytes) -> Sequence[ParsedMessage]:
    """Read a batch; an invalid item does not affect the others.

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
    return [_read_item(value) for value in listed]


def _read_item(value: object) -> ParsedMessage:
    """Parse one item.

    One that breaks its parser is rejected, else the gateway would retry it forever.
    """
    if not isinstance(value, list) or len(value) != 2:
        return ParsedMessage.unreadable("", cbor2.dumps(value), _NO_ITEM)
    node, data = value
    if not isinstance(node, str) or not isinstance(data, bytes):
        return ParsedMessage.unreadable("", cbor2.dumps(value), _NO_ITEM)
    if len(data) > MOST_BYTES:
        return ParsedMessage.unreadable(node, data, f"message of over {MOST_BYTES} bytes")
    try:
        return ParsedMessage.parse(node, data)
    except MemoryError:  # which is ours, and no message's
        raise
    except Exception as error:
        log.exception("message broke its parser: bytes=%d", len(data))
        reason = f"it broke what reads it: {type(error).__name__}"
        return ParsedMessage.rejected(node, b"", reason + WITHHELD.format(len(data)))
