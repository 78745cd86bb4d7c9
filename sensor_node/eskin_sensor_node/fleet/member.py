"""One node of a fleet, in the fleet's loop, and its controls."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.node.commands import CommandReceiver, NodeControls
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments, State
    from eskin_sensor_node.fleet.connection import Connection
    from eskin_sensor_node.fleet.outbox import MemberOutbox
    from eskin_sensor_node.fleet.shard import Shard
    from eskin_sensor_node.fleet.single_node import SingleNode


class Member:
    """One node of a fleet.

    Args:
        shard: The members that started with it.
        row: Its place there.
        connection: Its connection.
        cloud: Common name of the only server that may command it.

    Attributes:
        name: Its name.
        shard: As given.
        row: As given.
        connection: As given.
        outbox: Where its messages wait.
        commander: Executes the cloud's commands.
        more: Whether it has something to send.
    """

    __slots__ = ("commander", "connection", "more", "name", "outbox", "row", "shard")

    def __init__(self, shard: Shard, row: int, connection: Connection, *, cloud: str) -> None:
        self.name = shard.names[row]
        self.shard = shard
        self.row = row
        self.connection = connection
        self.outbox: MemberOutbox = shard.outboxes[row]
        self.commander = CommandReceiver(
            self.outbox,
            own=connection.keys.own,
            cloud=cloud,
            controls=MemberControls(shard, row),
            enclosure=lambda: shard.enclosure(row),
        )
        self.more = False

    @property
    def alone(self) -> SingleNode | None:
        """What it is where it samples alone."""
        return self.shard.singles.get(self.row)

    @property
    def running(self) -> bool:
        """Whether its firmware runs; else nothing is sent or taken."""
        return self.alone is None or self.alone.running

    def has_backlog(self) -> bool:
        """Whether its connection did not take all that was written."""
        return self.connection.writes

    def follow_keys(self, now: int) -> None:
        """Reload renewed keys; now: monotonic ns."""
        if self.connection.keys.refresh(now / BILLION):
            # A gateway cannot decrypt before it has seen the certificate.
            self.outbox.introduce(now)

    def catch_up(self) -> None:
        """Run what is due by now; it samples alone."""
        node = self.shard.singles[self.row]
        meter, connection = node.machine.ledger, self.connection
        meter.sent, connection.sent = meter.sent + connection.sent, 0
        meter.received, connection.received = meter.received + connection.received, 0
        node.catch_up()
        self.more = True

    def acknowledge(self) -> None:
        """Delete what gateways acknowledged, within the flash file's transaction."""
        self.outbox.acknowledge(self.connection.spans)
        if self.connection.time is not None:
            self.outbox.message_writer.observe_time(self.connection.time)

    def finish_acknowledging(self) -> None:
        """Clear what was acknowledged."""
        self.connection.spans = []
        self.more = True

    def take_commands(self) -> None:
        """Execute its commands.

        Raises:
            FlashError: A result was not stored; its command comes again.
        """
        asked, self.connection.commands = self.connection.commands, []
        for signed in asked:
            self.commander.take(signed)
            self.more = True


class MemberControls:
    """Controls of a member: it leaves its cohort, and later joins members set likewise.

    Args:
        shard: The members that started with it.
        row: Its place there.
    """

    __slots__ = ("_row", "_shard")

    def __init__(self, shard: Shard, row: int) -> None:
        self._shard = shard
        self._row = row

    def apply(self, name: str, arguments: Arguments) -> State:
        """As `eskin_sensor_node.node.commands.NodeControls.apply`."""
        node = self._shard.singles.get(self._row) or self._shard.make_single(self._row)
        state = NodeControls(node).apply(name, arguments)
        self._shard.part(self._row, node)
        return state

    @property
    def state(self) -> State:
        """The member's state."""
        node = self._shard.singles.get(self._row)
        return self._shard.designed if node is None else NodeControls(node).state

    def restore(self, state: State) -> State:
        """As `node.controls.NodeControls.restore`; as designed, it stays in its cohort."""
        designed, node = self._shard.designed, self._shard.singles.get(self._row)
        if node is None:
            if state in ({}, designed):
                return designed
            node = self._shard.make_single(self._row)
            self._shard.part(self._row, node)
        return NodeControls(node).restore(state)
