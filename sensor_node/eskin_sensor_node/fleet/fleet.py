"""Many nodes in one loop: sampled, stored, sent and acknowledged together."""

from __future__ import annotations

import logging
import selectors
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.fleet.connector import Connector
    from eskin_sensor_node.fleet.member import Member
    from eskin_sensor_node.fleet.shard import Shard
    from eskin_sensor_node.machine.flash.file import FlashFile
    from eskin_sensor_node.node.ground_truth import GroundTruth

log = logging.getLogger(__name__)

TURN: Final = BILLION // 40
"""A turn collects what comes in this time, ns, into one commit."""
_ROUND: Final = BILLION // 2
"""Longest time between two maintenance turns of a member, ns."""
_FAILED: Final = "member failed, continuing: node=%s failures=%d"
_MOST_AT_ONCE: Final = 16
"""Messages that one member sends before the next one's turn."""


class Fleet:
    """All members of one process.

    Args:
        members: The members, shard by shard.
        storage: Their flash file.
        truth: The ground truth.
        connector: Connects them.
    """

    def __init__(
        self,
        members: Sequence[Member],
        *,
        storage: FlashFile,
        truth: GroundTruth,
        connector: Connector,
    ) -> None:
        self._storage = storage
        self._truth = truth
        self._connector = connector
        self.members = members
        self._shards = list(dict.fromkeys(member.shard for member in members))
        self._of_shard: dict[Shard, list[Member]] = {shard: [] for shard in self._shards}
        for member in members:
            self._of_shard[member.shard].append(member)
        self._by_connection = {member.connection: member for member in self.members}
        self._selector = selectors.DefaultSelector()
        self._selector.register(connector.wake, selectors.EVENT_READ)
        self._cursor = 0
        self.failures = 0

    @property
    def online(self) -> int:
        """How many members are connected."""
        return sum(member.connection.online for member in self.members)

    @property
    def waiting(self) -> int:
        """Messages that no gateway has acknowledged."""
        return sum(member.outbox.messages for member in self.members)

    @property
    def drained(self) -> bool:
        """Whether no connected member waits for an acknowledgement."""
        return not any(
            member.connection.online and member.outbox.messages for member in self.members
        )

    def start(self) -> None:
        """Restore the settings of all members, and connect them.

        Raises:
            FlashError: Flash cannot be read or written.
        """
        with self._storage.commit():
            for member in self.members:
                member.commander.start()
        for shard, members in self._of_shard.items():
            shard.regroup(at_once=True)
            shard.restarted = lambda row, members=members: members[row].commander.start()  # type: ignore[misc]  # bound now
        for member in self.members:
            self._connector.connect(member.connection)

    def turn(self, *, sampling: bool = True) -> None:
        """Run one turn; waits a little for something to do."""
        begun = time.monotonic_ns()
        self._poll(begun + TURN)
        now = time.monotonic_ns()
        self._take_acknowledgements(now)
        self._take_commands()
        if sampling:
            self._sample(now)
        self._maintain(now)
        self._send(now)

    def finish(self) -> None:
        """Store what stays undecided at the end."""
        for shard in self._shards:
            self._store(shard, shard.finish())
            for node in shard.singles.values():
                node.finish()

    def close(self) -> None:
        """Disconnect all."""
        for member in self.members:
            if member.connection.socket is not None:
                member.connection.close()
        self._selector.close()

    def _poll(self, until: int) -> None:
        """Serve connections until an instant."""
        while (left := until - time.monotonic_ns()) > 0:
            for key, events in self._selector.select(left / BILLION):
                if key.data is None:
                    for connection in self._connector.ready():
                        self._register(self._by_connection[connection])
                else:
                    self._serve(key.data, readable=bool(events & selectors.EVENT_READ))

    def _register(self, member: Member) -> None:
        own = member.connection.socket
        if own is None:
            self._connector.connect(member.connection)
            return
        self._selector.register(own, selectors.EVENT_READ, member)
        self._serve(member, readable=True)

    def _serve(self, member: Member, *, readable: bool) -> None:
        own = member.connection.socket
        stands = False
        try:
            stands = member.connection.serve(readable=readable)
        except Exception:  # one member must not stop the others
            self.failures += 1
            log.exception(_FAILED, member.name, self.failures)
        if not stands or own is None:
            self._lose(member, own)
            return
        events = selectors.EVENT_READ
        if member.connection.writes:
            events |= selectors.EVENT_WRITE
        if self._selector.get_key(own).events != events:
            self._selector.modify(own, events, member)

    def _lose(self, member: Member, own: object) -> None:
        """A connection ended: forget it, and connect again."""
        gone = [key.fileobj for key in self._keys(own, member)]
        for each in gone:
            self._selector.unregister(each)
        log.log(
            logging.WARNING if member.connection.online else logging.DEBUG,
            "connection lost: node=%s",
            member.name,
        )
        member.connection.online = False
        self._connector.connect(member.connection)

    def _keys(self, own: object, member: Member) -> Iterable[selectors.SelectorKey]:
        if own is not None:
            return [key for key in [self._selector.get_map().get(own)] if key is not None]  # type: ignore[call-overload]  # a socket, closed by now
        return [key for key in self._selector.get_map().values() if key.data is member]

    def _take_acknowledgements(self, now: int) -> None:
        acknowledged = [
            member for member in self.members if member.connection.spans and member.running
        ]
        if not acknowledged:
            return
        try:
            with self._storage.commit():
                for member in acknowledged:
                    member.acknowledge()
        except FlashError as error:
            log.warning("acknowledgements not applied: error=%s", error)
            for member in acknowledged:
                member.outbox.resync(now)
        for member in acknowledged:
            with self._isolated(member):
                member.finish_acknowledging()

    def _take_commands(self) -> None:
        for member in self.members:
            if member.connection.commands and member.running:
                with self._isolated(member):
                    member.take_commands()

    def _sample(self, now: int) -> None:
        self._sample_singles()
        for shard in self._shards:
            shard.regroup()
            if shard.due() <= now:
                records, truth = shard.sample(now)
                try:
                    # Before the flash's commit: every stored block has its truth.
                    self._truth.store(truth, shard.settled(truth))
                except FlashError as error:
                    log.error("ground truth not written: error=%s", error)  # noqa: TRY400 - one line
                self._store(shard, records)

    def _sample_singles(self) -> None:
        """Run the nodes that sample alone, in one commit."""
        due = [
            self._of_shard[shard][row]
            for shard in self._shards
            for row, node in shard.singles.items()
            if node.due
        ]
        if not due:
            return
        for member in due:
            member.outbox.begin_savepoint()
        try:
            # The truth first: every stored block has it.
            with self._storage.commit(), self._truth.together():
                for member in due:
                    with self._isolated(member):
                        member.catch_up()
        except FlashError as error:
            log.error("flash commit failed, sampling continues: error=%s", error)  # noqa: TRY400 - likewise
            for member in due:
                member.outbox.undo()

    def _store(self, shard: Shard, records: dict[int, list[Record]]) -> None:
        """Store messages of a shard's members, in one commit."""
        gaps = {row: shard.outboxes[row].pending_gap() for row in records}
        try:
            with self._storage.commit():
                for row, found in records.items():
                    shard.outboxes[row].write(gaps[row] + found)
        except FlashError as error:
            log.error("flash commit failed, sampling continues: error=%s", error)  # noqa: TRY400 - likewise
            for row, found in records.items():
                shard.outboxes[row].lose(found)
            return
        for row, found in records.items():
            shard.outboxes[row].settle(gaps[row] + found)
        for row in records:
            self._of_shard[shard][row].more = True

    @contextmanager
    def _isolated(self, member: Member) -> Iterator[None]:
        """Catch and log one member's error."""
        try:
            yield
        except FlashError as error:
            log.warning("flash failed: node=%s error=%s", member.name, error)
        except Exception:
            self.failures += 1
            log.exception(_FAILED, member.name, self.failures)

    def _maintain(self, now: int) -> None:
        """Send statuses, pings and repeats, for some members at a time."""
        share = max(1, len(self.members) * TURN // _ROUND)
        begin, end = self._cursor, self._cursor + share
        self._cursor = end if end < len(self.members) else 0
        asking: dict[Shard, list[int]] = {}
        for number, member in enumerate(self.members):
            connection = member.connection
            if connection.fresh:
                connection.fresh = False
                member.outbox.connect(now)
                connection.descriptions = dict.fromkeys(member.outbox.descriptions())
            elif not begin <= number < end:
                continue
            member.follow_keys(now)
            if not connection.online or not member.running:
                continue
            member.more = True
            if not connection.keep_alive():
                self._lose(member, connection.socket)
            elif member.outbox.is_status_due(now):
                if member.alone is None:
                    asking.setdefault(member.shard, []).append(member.row)
                else:
                    with self._isolated(member):
                        member.alone.record_status()
        for shard, rows in asking.items():
            self._store(shard, {row: [shard.status(row, now)] for row in rows})

    def _send(self, now: int) -> None:
        for member in self.members:
            connection = member.connection
            if not (member.more and connection.online and member.running) or connection.writes:
                continue
            member.more = False
            with self._isolated(member):
                sent = connection.send_due(member.outbox, now, _MOST_AT_ONCE)
                member.more = sent == _MOST_AT_ONCE
            if member.has_backlog():
                self._serve(member, readable=False)
