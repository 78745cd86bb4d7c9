"""The position of a message that is authentic but cannot be read as a whole."""

from __future__ import annotations

from eskin.errors import MessageError
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_COUNT, integer, load_any


def poison_position(data: bytes) -> Position | None:
    """Boot and sequence (fields 2 and 3) where at least they can be read.

    With them the node can be answered, and stops sending what nobody can use.
    """
    try:
        fields = load_any(data, "message")
        if not isinstance(fields, dict):
            return None
        boot = integer(fields.get(2), "field 2", 0, MOST_COUNT)
        return Position(boot, integer(fields.get(3), "field 3", 0, MOST_COUNT))
    except MessageError:
        return None
