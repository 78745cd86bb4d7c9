"""What must hold at each step, and at the end."""

from __future__ import annotations

import hashlib
import sqlite3
from typing import TYPE_CHECKING, Any, Final

import orjson

from eskin.wire.frames import Statements
from eskin.wire.messages import Acknowledgement
from tests.robustness.simulation.node import is_frame, is_status

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.robustness.simulation.gateway import Gateway
    from tests.robustness.simulation.node import Made
    from tests.robustness.simulation.world import World

_DURABLE: Final = frozenset({"stored", "duplicate"})


class LawError(BaseException):
    """A law of delivery is broken. No `Exception`, because the product survives any of these."""


class Laws:
    """Checks what is durable, in the files and by connections of their own.

    Args:
        world: What is checked.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._connections: dict[Path, sqlite3.Connection] = {}

    def close(self) -> None:
        """Close the connections."""
        for each in self._connections.values():
            each.close()

    def _ask(self, path: Path, query: str, *values: object) -> list[Any]:
        connection = self._connections.get(path)
        if connection is None:
            connection = self._connections[path] = sqlite3.connect(path, isolation_level=None)
        return connection.execute(query, values).fetchall()

    # At each step.

    def check_acknowledgement(
        self, gateway: Gateway, node: str, topic: str, payload: bytes
    ) -> None:
        """Nothing is acknowledged to a node before it is durable.

        A gateway also acknowledges what comes after the node gave it up: a gap names that.
        """
        opened = self._world.parties.openers[node].open(payload, topic=topic)
        spans = Acknowledgement.decode(opened.plaintext).spans
        acknowledged = " ".join(f"{boot}/{first}..{last}" for boot, first, last in spans)
        self._world.timeline.note(gateway.name, f"acknowledges to {node}: {acknowledged}")
        for boot, first, last in spans:
            for sequence in range(first, last + 1):
                given_up = self._world.node(node).has_given_up((boot, sequence))
                if not given_up and not self._is_durable(node, boot, sequence):
                    raise LawError(
                        f"{gateway.name} acknowledges {node}/{boot}/{sequence}, which is in no "
                        "spool and not in the store"
                    )

    def _is_durable(self, node: str, boot: int, sequence: int) -> bool:
        spooled = "SELECT 1 FROM messages WHERE node = ? AND boot = ? AND sequence = ?"
        for each in self._world.gateways:
            if self._ask(each.path, spooled, node, boot, sequence):
                return True
        return self._is_stored(node, boot, sequence)

    def _is_stored(self, node: str, boot: int, sequence: int) -> bool:
        stored = "SELECT 1 FROM sequences WHERE node = ? AND boot = ? AND ? BETWEEN first AND last"
        return bool(self._ask(self._world.cloud.path, stored, node, boot, sequence))

    def check_answer(self, asked: list[tuple[str, int, int]], answered: bytes) -> None:
        """Nothing is answered to a gateway as stored before it is durable."""
        for position, item in zip(asked, orjson.loads(answered)["items"], strict=True):
            if item["result"] in _DURABLE and not self._is_stored(*position):
                raise LawError(f"the cloud answers {item['result']} for {position}: not stored")
            if item["result"] == "rejected":
                raise LawError(f"the cloud rejects {position}: {item['reason']}")

    def check_spool(self, gateway: Gateway) -> None:
        """No message is in a spool twice."""
        twice = "SELECT node, boot, sequence FROM messages GROUP BY 1, 2, 3 HAVING count(*) > 1"
        if found := self._ask(gateway.path, twice):
            raise LawError(f"{gateway.name} has spooled twice: {found[:3]}")

    # At the end.

    def check_all(self) -> None:
        """All that was durable is stored once, or a stored gap names it."""
        world = self._world
        stored, named = self._sequences(), set(self._named())
        for node in world.nodes:
            for position, made in node.made.items():
                key = node.name, *position
                if key in stored:
                    self._check_row(key, made)
                elif key not in named:
                    raise LawError(f"{_shown(key)} is neither stored nor named by a gap")
        alien = [key for key in stored if key[1:] not in world.node(key[0]).made]
        if alien:
            raise LawError(f"{_shown(alien[0])} is stored, and was never durable in a flash")
        self._check_erased()
        self._check_store()

    def _check_row(self, key: tuple[str, int, int], made: Made) -> None:
        """A message that counts as stored has its row; only one of an erased subject has none."""
        if is_status(made):
            return
        table = "frames" if is_frame(made) else "events"
        where = "WHERE node = ? AND boot = ? AND sequence = ?"
        plain = self._store(f"SELECT data FROM {table} {where} AND data IS NOT NULL", *key)  # noqa: S608 - our own names
        sealed = self._store(f"SELECT subject FROM sealed_messages {where}", *key)  # noqa: S608 - our own names
        is_sealed = made.subject is not None and made.subject not in self._world.erased
        if plain != ([(made.body,)] if made.subject is None else []) or sealed != (
            [(made.subject,)] if is_sealed else []
        ):
            raise LawError(
                f"{_shown(key)} has {len(plain)} rows and {len(sealed)} sealed ones: not those of "
                "what was made"
            )

    def _check_erased(self) -> None:
        """No message of an erased subject is stored, of whatever node."""
        for pseudonym in sorted(self._world.erased):
            if self._store("SELECT 1 FROM sealed_messages WHERE subject = ?", pseudonym):
                raise LawError("messages of an erased subject are stored")

    def _check_store(self) -> None:
        # Of sealed pages only the number of frames is known, by those that came.
        wrong = """
            SELECT p.node, p.page FROM pages AS p LEFT JOIN frames AS f
                ON f.node = p.node AND f.layout = p.layout AND f.page = p.page
            WHERE p.page = 0 GROUP BY p.node, p.layout, p.page
            HAVING p.frames <> count(f.sequence) OR p.samples <> coalesce(sum(f.samples), 0)
        """
        if found := self._store(wrong):
            raise LawError(f"totals of pages are not those of their frames: {found}")
        repeated = """
            SELECT cursor FROM (
                SELECT cursor FROM frames UNION ALL SELECT cursor FROM events
                UNION ALL SELECT cursor FROM sealed_messages
            ) GROUP BY cursor HAVING count(*) > 1
        """
        if found := self._store(repeated):
            raise LawError(f"a cursor was given twice: {found[0]}")
        if missing := self._store("SELECT node, boot, first, last FROM missing_ranges"):
            raise LawError(f"the cloud takes for missing: {missing[:3]}")
        if letters := self._store("SELECT node, reason FROM dead_letters"):
            raise LawError(f"dead letter in the cloud: {letters[0]}")
        for gateway in self._world.gateways:
            if letters := self._ask(gateway.path, "SELECT node, reason FROM dead_letters"):
                raise LawError(f"dead letter of {gateway.name}: {letters[0]}")

    def _sequences(self) -> set[tuple[str, int, int]]:
        rows = self._store("SELECT node, boot, first, last FROM sequences")
        return {(n, boot, k) for n, boot, first, last in rows for k in range(first, last + 1)}

    def _named(self) -> Iterator[tuple[str, int, int]]:
        """What stored gaps name."""
        for node, data in self._store(
            "SELECT node, data FROM events WHERE kind = 'gap' AND data IS NOT NULL"
        ):
            for gap in Statements.decode(data).gaps:
                for boot, first, last in gap.lost:
                    yield from ((node, boot, k) for k in range(first, last + 1))

    def _store(self, query: str, *values: object) -> list[Any]:
        return self._ask(self._world.cloud.path, query, *values)

    def digest(self) -> str:
        """Of what is stored at the end, without what keys and nonces decide."""
        found = hashlib.sha256()
        for query in (
            "SELECT node, boot, sequence, cursor, page, t, received, data FROM frames",
            "SELECT node, cursor, boot, sequence, kind, t_lo, received, data FROM events",
            "SELECT node, boot, sequence, cursor, kind, t_lo, received FROM sealed_messages",
            "SELECT node, boot, first, last FROM sequences",
            "SELECT node, boot, first, last FROM lost_ranges",
            "SELECT gateway, stored, duplicate FROM gateways",
        ):
            for row in sorted(self._store(query), key=repr):
                found.update(repr(row).encode())
        return found.hexdigest()


def _shown(key: tuple[str, int, int]) -> str:
    return "/".join(map(str, key))
