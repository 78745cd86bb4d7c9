"""Many nodes in one loop: sampled, stored, sent and acknowledged together."""

from __future__ import annotations

import logging
import selectors
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin_sensor_node.machine.crystal import BILLION

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.fleet.connector import Connector
    from eskin_sensor_node.fleet.member import Member
    from eskin_sensor_node.fleet.shard import Shard
    from eskin_sensor_node.fleet.storage import Storage
    from eskin_sensor_node.node.ground_truth import GroundTruth

log = logging.getLogger(__name__)

TURN: Final = BILLION // 40
"""A turn collects what comes in this time, ns, into one commit."""
_ROUND: Final = BILLION // 2
"""Each member is looked after at least so often, ns."""
_FAILED: Final = "a node failed and goes on: node=%s failures=%d"
_MOST_AT_ONCE: Final = 16
"""Messages that one member sends before the next one's turn."""


class Fleet:
    """All members of one process.

    Args:
        members: They, shard by shard.
        storage: Where they keep what they say.
        truth: What the emulator keeps.
        connector: Connects them.
    """

    def __init__(
        self,
        members: Sequence[Member],
        *,
        storage: Storage,
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
        self._by_radio = {member.radio: member for member in self.members}
        self._selector = selectors.DefaultSelector()
        self._selector.register(connector.wake, selectors.EVENT_READ)
        self._cursor = 0
        self.failures = 0

    @property
    def online(self) -> int:
        """Members that the broker has taken."""
        return sum(member.radio.online for member in self.members)

    @property
    def waiting(self) -> int:
        """Messages that no gateway has acknowledged."""
        return sum(member.outbox.messages for member in self.members)

    @property
    def drained(self) -> bool:
        """Whether nobody who is online waits for an acknowledgement."""
        return not any(member.radio.online and member.outbox.messages for member in self.members)

    def start(self) -> None:
        """Let all members take up how they were set, and connect.

        Raises:
            FlashError: Flash cannot be read or written.
        """
        with self._storage.commit():
            for member in self.members:
                member.commander.start()
        for shard, members in self._of_shard.items():
            shard.gather(at_once=True)
            shard.restarted = lambda row, members=members: members[row].commander.start()  # type: ignore[misc]  # bound now
        for member in self.members:
            self._connector.connect(member.radio)

    def turn(self, *, sampling: bool = True) -> None:
        """Do what is to be done now; waits a little for something to do."""
        begun = time.monotonic_ns()
        self._listen(begun + TURN)
        now = time.monotonic_ns()
        self._take_acknowledgements(now)
        self._take_commands()
        if sampling:
            self._sample(now)
        self._look_after(now)
        self._send(now)

    def finish(self) -> None:
        """Store what stays undecided at the end."""
        for shard in self._shards:
            self._store(shard, shard.finish())
            for node in shard.singles.values():
                node.finish()

    def close(self) -> None:
        """Say goodbye for all."""
        for member in self.members:
            if member.radio.socket is not None:
                member.radio.close()
        self._selector.close()

    def _listen(self, until: int) -> None:
        """Serve connections until a moment."""
        while (left := until - time.monotonic_ns()) > 0:
            for key, events in self._selector.select(left / BILLION):
                if key.data is None:
                    for radio in self._connector.ready():
                        self._join(self._by_radio[radio])
                else:
                    self._serve(key.data, readable=bool(events & selectors.EVENT_READ))

    def _join(self, member: Member) -> None:
        own = member.radio.socket
        if own is None:
            self._connector.connect(member.radio)
            return
        self._selector.register(own, selectors.EVENT_READ, member)
        self._serve(member, readable=True)

    def _serve(self, member: Member, *, readable: bool) -> None:
        own = member.radio.socket
        stands = False
        try:
            stands = member.radio.serve(readable=readable)
        except Exception:  # one member's trouble is not the others'
            self.failures += 1
            log.exception(_FAILED, member.name, self.failures)
        if not stands or own is None:
            self._lose(member, own)
            return
        events = selectors.EVENT_READ
        if member.radio.writes:
            events |= selectors.EVENT_WRITE
        if self._selector.get_key(own).events != events:
            self._selector.modify(own, events, member)

    def _lose(self, member: Member, own: object) -> None:
        """A connection ended: forget it, and connect again."""
        gone = [key.fileobj for key in self._keys(own, member)]
        for each in gone:
            self._selector.unregister(each)
        log.log(
            logging.WARNING if member.radio.online else logging.DEBUG,
            "connection lost, messages wait: node=%s",
            member.name,
        )
        member.radio.online = False
        self._connector.connect(member.radio)

    def _keys(self, own: object, member: Member) -> Iterable[selectors.SelectorKey]:
        if own is not None:
            return [key for key in [self._selector.get_map().get(own)] if key is not None]  # type: ignore[call-overload]  # a socket, closed by now
        return [key for key in self._selector.get_map().values() if key.data is member]

    def _take_acknowledgements(self, now: int) -> None:
        heard = [member for member in self.members if member.radio.spans and member.running]
        if not heard:
            return
        try:
            with self._storage.commit():
                for member in heard:
                    member.acknowledge()
        except FlashError as error:
            log.warning("acknowledgements are not taken, and will come again: error=%s", error)
            for member in heard:
                member.outbox.look_again(now)
        for member in heard:
            with self._tolerant(member):
                member.heed()

    def _take_commands(self) -> None:
        for member in self.members:
            if member.radio.commands and member.running:
                with self._tolerant(member):
                    member.take_commands()

    def _sample(self, now: int) -> None:
        self._sample_alone()
        for shard in self._shards:
            shard.gather()
            if shard.due() <= now:
                records, truth = shard.sample(now)
                try:
                    # Before the storage's commit: every stored block has its truth.
                    self._truth.store(truth, shard.settled(truth))
                except FlashError as error:
                    log.error("the truth fails: error=%s", error)  # noqa: TRY400 - says all
                self._store(shard, records)

    def _sample_alone(self) -> None:
        """Let those catch up who sample alone, and make durable what they say, in one commit."""
        due = [
            self._of_shard[shard][row]
            for shard in self._shards
            for row, node in shard.singles.items()
            if node.due
        ]
        if not due:
            return
        for member in due:
            member.outbox.mark()
        try:
            # The truth first: every stored block has it.
            with self._storage.commit(), self._truth.together():
                for member in due:
                    with self._tolerant(member):
                        member.catch_up()
        except FlashError as error:
            log.error("storage fails, sampling goes on: error=%s", error)  # noqa: TRY400 - likewise
            for member in due:
                member.outbox.undo()

    def _store(self, shard: Shard, records: dict[int, list[Record]]) -> None:
        """Make what members of a shard say durable, in one commit."""
        told = {row: shard.outboxes[row].unsaid() for row in records}
        try:
            with self._storage.commit():
                for row, said in records.items():
                    shard.outboxes[row].write(told[row] + said)
        except FlashError as error:
            log.error("storage fails, sampling goes on: error=%s", error)  # noqa: TRY400 - likewise
            for row, said in records.items():
                shard.outboxes[row].lose(said)
            return
        for row, said in records.items():
            shard.outboxes[row].settle(told[row] + said)
        for row in records:
            self._of_shard[shard][row].more = True

    @contextmanager
    def _tolerant(self, member: Member) -> Iterator[None]:
        """One member's trouble is not the others'."""
        try:
            yield
        except FlashError as error:
            log.warning("flash fails: node=%s error=%s", member.name, error)
        except Exception:
            self.failures += 1
            log.exception(_FAILED, member.name, self.failures)

    def _look_after(self, now: int) -> None:
        """Introduce those who are new, tell states, ping, and send again, some at a time."""
        share = max(1, len(self.members) * TURN // _ROUND)
        begin, end = self._cursor, self._cursor + share
        self._cursor = end if end < len(self.members) else 0
        asking: dict[Shard, list[int]] = {}
        for number, member in enumerate(self.members):
            radio = member.radio
            if radio.fresh:
                radio.fresh = False
                member.outbox.connect(now)
            elif not begin <= number < end:
                continue
            member.follow_keys(now)
            if not radio.online or not member.running:
                continue
            member.more = True
            if not radio.keep_alive():
                self._lose(member, radio.socket)
            elif member.outbox.tell_status(now):
                if member.alone is None:
                    asking.setdefault(member.shard, []).append(member.row)
                else:
                    with self._tolerant(member):
                        member.alone.record_status()
        for shard, rows in asking.items():
            self._store(shard, {row: [shard.status(row, now)] for row in rows})

    def _send(self, now: int) -> None:
        for member in self.members:
            radio = member.radio
            if not (member.more and radio.online and member.running) or radio.writes:
                continue
            member.more = False
            with self._tolerant(member):
                sent = radio.send_due(member.outbox, now, _MOST_AT_ONCE)
                member.more = sent == _MOST_AT_ONCE
            if member.has_backlog():
                self._serve(member, readable=False)
