"""Which commands a gateway receives: of each node the oldest one without an answer."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cbor2
from sqlalchemy import exists, func, select, update

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, items, load_any, real
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.schema.node_key import of_node, of_same_node
from eskin_cloud.store.schema.tables import commands, node_sites
from eskin_cloud.store.write.commands import find_command

if TYPE_CHECKING:
    from sqlalchemy import ColumnElement, Connection


MOST_HELD: Final = 10_000
MOST_GIVEN: Final = 500
LONGEST_WAIT_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Holding:
    """A gateway's request for commands.

    Attributes:
        held: ``(node, id)`` of the commands that the gateway has.
        sent: Those that it has handed to its broker.
        wait_s: How long the gateway waits for a change.
        published: The number of the last change of an alarm that it has published; ``None`` where
            it has just started.
    """

    held: frozenset[tuple[str, int]]
    sent: frozenset[tuple[str, int]]
    wait_s: float
    published: int | None

    @classmethod
    def read(cls, body: bytes) -> Holding:
        """Read a request's body.

        Raises:
            MalformedBatchError: It is none.
        """
        try:
            asked = _load(body)
            listed = [_entry(item) for item in items(asked["held"], "held", MOST_HELD)]
            wait = real(asked["wait_s"], "wait_s", 0.0, LONGEST_WAIT_S)
            number = asked["published"]
            if number is not None:
                number = integer(number, "published", 0, MOST_COUNT)
        except MessageError as error:
            raise MalformedBatchError(f"{error}; see deliveries in docs/eskin.cddl") from error
        return cls(
            frozenset((node, number) for node, number, _ in listed),
            frozenset((node, number) for node, number, sent in listed if sent),
            wait,
            number,
        )


@dataclass(frozen=True, slots=True)
class Changes:
    """The answer to a gateway.

    Attributes:
        give: ``(node, id, signed command)`` that the gateway must deliver.
        drop: ``(node, id)`` that it must no longer deliver.
        alarms: ``(number, monitor, document)`` of changes of alarms that it should publish.
    """

    give: list[tuple[str, int, bytes]]
    drop: list[tuple[str, int]]
    alarms: list[tuple[int, str, str]]

    def __bool__(self) -> bool:
        return bool(self.give or self.drop or self.alarms)

    def encode(self) -> bytes:
        """Write as CBOR."""
        return cbor2.dumps(
            {
                "give": [list(one) for one in self.give],
                "drop": [list(one) for one in self.drop],
                "alarms": [list(one) for one in self.alarms],
            }
        )


def find_changes(connection: Connection, holding: Holding, *, site: str, now: int) -> Changes:
    """Compare the commands that a gateway has with what it should have.

    Commands of a node are given one by one, so that they are done in the order of their ids, and to
    gateways of its site alone.
    """
    c = commands.c
    waiting = select(c.node, func.min(c.id)).where(c.outcome.is_(None), c.expires > now)
    waiting = waiting.where(_is_of(site)).group_by(c.slot, c.node)
    current = {(row[0], row[1]) for row in connection.execute(waiting)}
    room = max(0, min(MOST_GIVEN, MOST_HELD - len(holding.held & current)))
    give = []
    for node, number in sorted(current - holding.held)[:room]:
        row = find_command(connection, node, number)
        if row is not None:
            give.append((node, number, bytes(row["data"])))
    return Changes(give, sorted(holding.held - current), [])


def find_unmarked(connection: Connection, holding: Holding, *, site: str) -> list[tuple[str, int]]:
    """Commands that a gateway has published, and that are not recorded as published."""
    c = commands.c
    query = select(c.node, c.id).where(c.outcome.is_(None), c.delivered.is_(None), _is_of(site))
    return sorted(holding.sent & {(row[0], row[1]) for row in connection.execute(query)})


def mark_delivered(connection: Connection, sent: list[tuple[str, int]], *, now: int) -> None:
    """Record when a gateway first published commands to its broker."""
    c = commands.c
    for node, number in sent:
        here = of_node(commands, node) & (c.id == number) & c.delivered.is_(None)
        connection.execute(update(commands).where(here).values(delivered=now))


def _is_of(site: str) -> ColumnElement[bool]:
    """Whether a command is for a node of a site."""
    n = node_sites.c
    return exists().where(of_same_node(node_sites, commands), n.site == site).correlate(commands)


def _load(body: bytes) -> dict[object, object]:
    asked = load_any(body, "body")
    if not isinstance(asked, dict) or set(asked) != {"held", "wait_s", "published"}:
        raise MessageError("the body is no map of held, wait_s and published")
    return asked


def _entry(value: object) -> tuple[str, int, bool]:
    found = items(value, "held", 3)
    if len(found) != 3 or not isinstance(found[0], str) or not isinstance(found[2], bool):
        raise MessageError("held is no array of [node, id, sent]")
    return found[0], integer(found[1], "held, id", 1, MOST_COUNT), found[2]


class Notifier:
    """Wakes the gateways that wait for commands; on the event loop only.

    Attributes:
        version: Grows with every change.
        waiting: How many gateways wait.
        closed: Whether waiting has ended.
    """

    def __init__(self) -> None:
        self.version = 0
        self.waiting = 0
        self.closed = False
        self._news = asyncio.Event()

    def wake(self) -> None:
        """Notify waiting gateways that a command was issued or answered."""
        self.version += 1
        self._news.set()
        self._news = asyncio.Event()

    def close(self) -> None:
        """Wake all waiters and close."""
        self.closed = True
        self.wake()

    async def wait(self, version: int, seconds: float) -> None:
        """Wait until something changed after a version, or the time is over."""
        news = self._news
        if self.version != version or self.closed:
            return
        self.waiting += 1
        try:
            await asyncio.wait_for(news.wait(), seconds)
        except TimeoutError:
            return
        finally:
            self.waiting -= 1
