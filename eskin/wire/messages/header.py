"""What all messages of a node begin with: kind, boot, sequence."""

from __future__ import annotations

import re
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from eskin.wire.messages.cbor_map import MOST_COUNT

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

CHANNEL = re.compile(r"[a-z0-9][a-z0-9_-]{0,30}\.[a-z][a-z0-9_]{0,30}")
"""A channel is ``{taxel}.{quantity}``, such as ``t03.capacitance``."""


class Kind(IntEnum):
    """What a message is (field 1)."""

    FRAME = 1
    STATEMENTS = 2
    PATCH = 3
    LAYOUT = 4
    STATUS = 5
    RESULT = 6
    ENCRYPTED = 7
    ACKNOWLEDGEMENT = 8
    COMMAND = 9
    RELEASE = 10


class Position(NamedTuple):
    """A message's place in all that a node ever sent; a tuple, because there are many.

    With the node's name it is the idempotency key.

    Attributes:
        boot: Counts the node's starts; kept in its flash.
        sequence: Counts the messages since that start, from 0.
    """

    boot: int
    sequence: int


def position_fields(kind: Kind, position: Position) -> dict[int, object]:
    """Fields 1 to 3."""
    return {1: int(kind), 2: position.boot, 3: position.sequence}


def read_position(fields: Fields) -> Position:
    """Read fields 2 and 3."""
    return Position(fields.integer(2, 0, MOST_COUNT), fields.integer(3, 0, MOST_COUNT))
