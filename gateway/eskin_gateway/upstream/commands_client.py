"""Fetches commands from the cloud by long polling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cbor2

from eskin.errors import MessageError
from eskin.identity import IdentityKind
from eskin.wire.messages.cbor_map import MOST_BYTES, MOST_COUNT, integer, items, load_any
from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.cloud_client import CloudClient

_MAX_PENDING: Final = 10_000


@dataclass(frozen=True, slots=True)
class CommandChanges:
    """Changes of the pending commands.

    Attributes:
        give: ``(node, id, signed command)`` to deliver.
        drop: ``(node, id)`` to deliver no longer.
    """

    give: list[tuple[str, int, bytes]]
    drop: list[tuple[str, int]]

    @classmethod
    def decode(cls, body: bytes) -> CommandChanges:
        """Decode a response.

        Raises:
            CloudError: It is invalid.
        """
        with parsing(body):
            lists = load_any(body, "the response")
            give = [_command(item) for item in _list(lists, "give")]
            drop = [_key(item, 2) for item in _list(lists, "drop")]
        return cls(give, drop)


class CommandsClient:
    """The cloud's ``deliveries``.

    Args:
        client: Posts to the cloud.
    """

    def __init__(self, client: CloudClient) -> None:
        self._client = client

    def fetch(self, pending: Sequence[tuple[str, int, bool]], wait_s: float) -> CommandChanges:
        """Ask for changes, and wait for one.

        Args:
            pending: ``(node, id, published)`` of the commands that the gateway has.
            wait_s: Seconds to wait at most.

        Raises:
            CloudError: The request failed.
        """
        body = cbor2.dumps(
            {"held": [list(item) for item in pending[:_MAX_PENDING]], "wait_s": wait_s}
        )
        return CommandChanges.decode(self._client.post("deliveries", body, wait_s=wait_s))

    def abort(self) -> None:
        """End the open request, from another thread."""
        self._client.abort()

    def close(self) -> None:
        """Close the connection."""
        self._client.close()


def _list(lists: object, name: str) -> list[object]:
    if not isinstance(lists, dict) or set(lists) != {"give", "drop"}:
        raise MessageError("it is no map of give and drop")
    return items(lists[name], name, _MAX_PENDING)


def _command(item: object) -> tuple[str, int, bytes]:
    node, number = _key(item, 3)
    signed = items(item, "entry", 3)[2]
    if not isinstance(signed, bytes) or len(signed) > MOST_BYTES:
        raise MessageError(f"the command of {node} is no byte string of at most {MOST_BYTES}")
    return node, number, signed


def _key(item: object, parts: int) -> tuple[str, int]:
    entry = items(item, "entry", parts)
    if len(entry) != parts or not isinstance(entry[0], str):
        raise MessageError("an entry does not begin with a node's name and an id")
    return IdentityKind.NODE.require_name(entry[0]), integer(entry[1], "id", 1, MOST_COUNT)
