"""Messages confirmed to a gateway: CBOR array of ``[node, boot, last]``."""

from __future__ import annotations

from typing import Final

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, items, load_any
from eskin_cloud.ingest.errors import MalformedBatchError

MOST: Final = 10_000


def read_confirmed(body: bytes) -> list[tuple[str, int, int]]:
    """Read it: node, boot, and the greatest number of it.

    Raises:
        MalformedBatchError: It is something else.
    """
    try:
        return [_read(each) for each in items(load_any(body, "body"), "body", MOST)]
    except (MessageError, IdentityError) as error:
        raise MalformedBatchError(f"{error}; send a CBOR array of [node, boot, last]") from error


def _read(value: object) -> tuple[str, int, int]:
    found = items(value, "item", 3)
    if len(found) != 3 or not isinstance(found[0], str):
        raise MessageError("item is no array of a node's name, a boot and a number")
    IdentityKind.NODE.require_name(found[0])
    return (
        found[0],
        integer(found[1], "boot", 0, MOST_COUNT),
        integer(found[2], "last", 0, MOST_COUNT),
    )
