"""The thread that fetches commands and alarms from the cloud by long polling."""

from __future__ import annotations

import json
import logging
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cbor2

from eskin.errors import MessageError, shown
from eskin.identity import IdentityKind
from eskin.runtime.supervised import Supervised
from eskin.wire.messages.cbor_map import MOST_BYTES, MOST_COUNT, integer, items, load_any
from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.runtime.supervised import Backoff
    from eskin_gateway.commands.publisher import PendingCommands
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.publish.alarms import AlarmPublisher
    from eskin_gateway.upstream.cloud_client import CloudClient


log = logging.getLogger(__name__)

_TICK_S: Final = 0.05
_MAX_TICKS: Final = 20
_MAX_PENDING: Final = 10_000
_MONITOR: Final = re.compile("[a-z0-9][a-z0-9-]{0,62}")


@dataclass(frozen=True, slots=True)
class CommandChanges:
    """Changes of the pending commands.

    Attributes:
        give: ``(node, id, signed command)`` to deliver.
        drop: ``(node, id)`` to deliver no longer.
        alarms: ``(number, monitor, document)`` of changes of alarms to publish.
    """

    give: list[tuple[str, int, bytes]]
    drop: list[tuple[str, int]]
    alarms: list[tuple[int, str, bytes]]

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
            alarms = [_alarm(item) for item in _list(lists, "alarms")]
        return cls(give, drop, alarms)


class CommandsClient:
    """The cloud's ``deliveries``.

    Args:
        client: Posts to the cloud.
    """

    def __init__(self, client: CloudClient) -> None:
        self._client = client

    def fetch(
        self, pending: Sequence[tuple[str, int, bool]], wait_s: float, published: int | None
    ) -> CommandChanges:
        """Ask for changes, and wait for one.

        Args:
            pending: ``(node, id, published)`` of the commands that the gateway has.
            wait_s: Seconds to wait at most.
            published: Up to which number changes of alarms are published; ``None`` for none.

        Raises:
            CloudError: The request failed.
        """
        body = cbor2.dumps(
            {
                "held": [list(item) for item in pending[:_MAX_PENDING]],
                "wait_s": wait_s,
                "published": published,
            }
        )
        return CommandChanges.decode(self._client.post("deliveries", body, wait_s=wait_s))

    def abort(self) -> None:
        """End the open request, from another thread."""
        self._client.abort()

    def close(self) -> None:
        """Close the connection."""
        self._client.close()


def _list(lists: object, name: str) -> list[object]:
    if not isinstance(lists, dict) or set(lists) != {"give", "drop", "alarms"}:
        raise MessageError("it is no map of give, drop and alarms")
    return items(lists[name], name, _MAX_PENDING)


def _command(item: object) -> tuple[str, int, bytes]:
    node, number = _key(item, 3)
    signed = items(item, "entry", 3)[2]
    if not isinstance(signed, bytes) or len(signed) > MOST_BYTES:
        raise MessageError(f"the command of {node} is no byte string of at most {MOST_BYTES}")
    return node, number, signed


def _alarm(item: object) -> tuple[int, str, bytes]:
    entry = items(item, "entry", 3)
    if len(entry) != 3 or not isinstance(entry[2], str):
        raise MessageError("an alarm is no number, monitor and document")
    monitor = entry[1]
    if not isinstance(monitor, str) or _MONITOR.fullmatch(monitor) is None:
        raise MessageError(f"{shown(monitor)} is no name of a monitor")
    try:
        document = json.loads(entry[2])
    except ValueError as error:
        raise MessageError(f"the document of {monitor} is no JSON: {error}") from error
    if not isinstance(document, dict) or not isinstance(document.get("transition"), str):
        raise MessageError(f"the document of {monitor} has no transition")
    return integer(entry[0], "number", 1, MOST_COUNT), monitor, entry[2].encode()


def _key(item: object, parts: int) -> tuple[str, int]:
    entry = items(item, "entry", parts)
    if len(entry) != parts or not isinstance(entry[0], str):
        raise MessageError("an entry does not begin with a node's name and an id")
    return IdentityKind.NODE.require_name(entry[0]), integer(entry[1], "id", 1, MOST_COUNT)


class CommandPoller:
    """Polls the cloud; each request ends when something changes.

    Args:
        commands: Updated with the changes.
        alarms: Updated with the changes of alarms.
        commands_client: Asks the cloud.
        wait_s: Most seconds of a request.
        backoff: Delays after failures.
        metrics: Counts failures.
    """

    def __init__(
        self,
        commands: PendingCommands,
        alarms: AlarmPublisher,
        *,
        commands_client: CommandsClient,
        wait_s: float,
        backoff: Backoff,
        metrics: Metrics,
    ) -> None:
        self._commands = commands
        self._alarms = alarms
        self._commands_client = commands_client
        self._wait_s = wait_s
        self._thread = Supervised(
            "command_poller",
            self._poll,
            backoff=backoff,
            on_failure=lambda _: metrics.cloud_failures.inc(),
        )

    @property
    def fault(self) -> str | None:
        """Why no commands can be fetched."""
        return self._thread.fault

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the open request and the thread."""
        self._thread.stopping.set()
        self._commands_client.abort()
        self._thread.stop()
        self._commands_client.close()

    def _poll(self) -> bool:
        # After a failure, a request that does not wait shows soonest that the cloud is back.
        wait_s = 0.0 if self.fault is not None else self._wait_s
        pending, published = self._commands.pending(), self._alarms.published
        changes = self._commands_client.fetch(pending, wait_s, published)
        self._thread.succeeded()
        self._alarms.give(changes.alarms)
        self._commands.change(changes.give, changes.drop)
        if changes.give:
            log.info("commands fetched: nodes=%d", len(changes.give))
        # Wait until they are published, so that the next request reports it.
        for _ in range(_MAX_TICKS):
            if self._thread.stopping.wait(_TICK_S):
                break
            sent = all(published for _, _, published in self._commands.pending())
            if sent and self._alarms.idle:
                break
        return True
