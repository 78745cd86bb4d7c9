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


def read_batch(body: bytes) -> Sequence[ParsedMessage]:
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
    items = iter(_read([each for each in said if not isinstance(each, ParsedMessage)]))
    return [each if isinstance(each, ParsedMessage) else next(items) for each in said]


def _said(value: object) -> tuple[str, bytes] | ParsedMessage:
    """A node and what it said; an item where that is not what stands there."""
    if isinstance(value, list) and len(value) == 2:
        node, data = value
        if isinstance(node, str) and isinstance(data, bytes):
            if len(data) > MOST_BYTES:
                reason = f"message of over {MOST_BYTES} bytes"
                return ParsedMessage.unreadable(node, data, reason)
            return node, data
    reason = "the item is no array of a node's name and bytes"
    return ParsedMessage.unreadable("", cbor2.dumps(value), reason)


def _read(said: Sequence[tuple[str, bytes]]) -> Sequence[ParsedMessage]:
    """Read messages; else one that breaks what reads it would be brought for ever."""
    try:
        return ParsedMessage.parse_all(said)
    except MemoryError:  # which is ours, and no message's
        raise
    except Exception as error:
        if len(said) > 1:
            return [item for each in said for item in _read([each])]
        node, data = said[0]
        log.exception("message broke what reads it: bytes=%d", len(data))
        reason = f"it broke what reads it: {type(error).__name__}"
        return [ParsedMessage.rejected(node, b"", reason + WITHHELD.format(len(data)))]
