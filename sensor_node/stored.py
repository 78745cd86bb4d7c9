"""A message as flash keeps it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from eskin.messages import Block, Gap, Kind, Peak, Result, Status
from sensor_node.firmware.record import Record

if TYPE_CHECKING:
    from eskin.messages import Message, Position

SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS counter (name TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
INSERT OR IGNORE INTO counter VALUES ('boot', 0), ('gaps', 0);
CREATE TABLE IF NOT EXISTS message (
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    weight INTEGER NOT NULL,   -- what gives way first: 0 raw block, 1 peak, gap, status, 2 result
    earliest INTEGER NOT NULL, -- UTC ns
    latest INTEGER NOT NULL,
    samples INTEGER NOT NULL,
    stands_for INTEGER NOT NULL, -- messages: itself, and those that a gap names
    kind INTEGER NOT NULL,
    body BLOB NOT NULL,
    PRIMARY KEY (boot, sequence)
) STRICT;
CREATE TABLE IF NOT EXISTS answer ( -- the last result: by it no command is done twice
    one INTEGER PRIMARY KEY CHECK (one = 1),
    body BLOB NOT NULL
) STRICT;
CREATE INDEX IF NOT EXISTS message_weight ON message (weight, boot, sequence);
"""

_KINDS: Final[dict[type, Kind]] = {
    Block: Kind.BLOCK,
    Peak: Kind.PEAK,
    Gap: Kind.GAP,
    Status: Kind.STATUS,
    Result: Kind.RESULT,
}
WEIGHTS: Final[dict[int, int]] = {Kind.BLOCK: 0, Kind.RESULT: 2}
"""What gives way first in a full flash; other kinds weigh 1."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A message that waits.

    Attributes:
        position: Its boot and sequence.
        kind: See `eskin.messages.Kind`.
        body: Its plaintext.
    """

    position: Position
    kind: int
    body: bytes


def record_of(message: Message) -> Record:
    """A message as the firmware would hand it over."""
    time, samples = _affects(message)
    kind = int(_KINDS[type(message)])
    named = message.messages if isinstance(message, Gap) else 0
    return Record(kind, message.position.sequence, message.encode(), time, samples, named)


def _affects(message: Message) -> tuple[tuple[int, int], int]:
    """The time that a message tells of (UTC ns), and the samples that go with it."""
    if isinstance(message, Block):
        tube = message.tube
        length = tube.dt * (len(tube) - 1)
        return (tube.time[0], tube.time[1] + length), len(tube)
    return message.time, message.samples if isinstance(message, Gap) else 0
