"""One node of a fleet, as its loop sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.fleet.controls import MemberControls
from eskin_sensor_node.machine.crystal import BILLION
from eskin_sensor_node.node.commands import Commander

if TYPE_CHECKING:
    from eskin_sensor_node.fleet.outbox import MemberOutbox
    from eskin_sensor_node.fleet.radio import Radio
    from eskin_sensor_node.fleet.shard import Shard
    from eskin_sensor_node.fleet.single_node import SingleNode


_MS: Final = 1000


class Member:
    """One node of a fleet.

    Args:
        shard: With whom it samples.
        row: Its place there.
        radio: Its connection.
        cloud: Common name of the only server that may command it.

    Attributes:
        name: Its name.
        shard: As given.
        row: As given.
        radio: As given.
        outbox: Where its messages wait.
        commander: Does what the cloud asks of it.
        more: Whether it has something to send.
        watched: ms for which somebody looks on, as the last acknowledgements say.
    """

    __slots__ = ("commander", "more", "name", "outbox", "radio", "row", "shard", "watched")

    def __init__(self, shard: Shard, row: int, radio: Radio, *, cloud: str) -> None:
        self.name = shard.names[row]
        self.shard = shard
        self.row = row
        self.radio = radio
        self.outbox: MemberOutbox = shard.outboxes[row]
        self.commander = Commander(
            self.outbox,
            own=radio.keys.own,
            cloud=cloud,
            controls=MemberControls(shard, row),
            enclosure=lambda: shard.enclosure(row),
        )
        self.more = False
        self.watched = 0

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
        return self.radio.writes

    def follow_keys(self, now: int) -> None:
        """Seal with what was renewed; now: monotonic ns."""
        if self.radio.keys.refresh(now / BILLION):
            # A gateway opens nothing of a certificate that it has not seen.
            self.outbox.introduce(now)

    def catch_up(self) -> None:
        """Do what is due by now; it samples alone."""
        node = self.shard.singles[self.row]
        meter, radio = node.machine.ledger, self.radio
        meter.sent, radio.sent = meter.sent + radio.sent, 0
        meter.received, radio.received = meter.received + radio.received, 0
        node.catch_up()
        self.more = True

    def acknowledge(self) -> None:
        """Forget what gateways have; within the storage's transaction."""
        # A copy, of which nothing is under way, tells of nobody who looks on.
        looks = [each for each in self.radio.looks if self.outbox.awaits(each.spans)]
        self.watched = max((each.watched for each in looks), default=0)
        self.outbox.acknowledge(self.radio.spans)
        if self.radio.time is not None:
            self.outbox.message_writer.hear(self.radio.time)

    def heed(self) -> None:
        """They are done with; somebody may look on."""
        self.radio.spans, self.radio.looks = [], []
        self.more = True
        if self.watched:
            self.shard.attend(self.row, self.watched / _MS)

    def take_commands(self) -> None:
        """Do what it was asked.

        Raises:
            FlashError: A result could not be kept; its command comes again.
        """
        asked, self.radio.commands = self.radio.commands, []
        for signed in asked:
            self.commander.take(signed)
            self.more = True
