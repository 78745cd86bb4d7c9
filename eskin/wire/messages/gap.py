"""A gap on the wire: what a node had to give up, said aloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import MOST_COUNT, dump, integer, items, load
from eskin.wire.messages.header import Kind, Position, position_fields, read_position

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

_FIELDS: Final = frozenset(range(1, 9))
_MOST_RANGES: Final = 64


@dataclass(frozen=True, slots=True)
class Gap:
    """Messages that a full flash gave up, or samples that were never taken.

    Attributes:
        position: Boot and sequence of this message.
        reason: Such as ``flash full`` or ``sampling overrun``.
        time: UTC ns, from the earliest to the latest moment that is affected.
        messages: How many messages were given up.
        samples: How many samples were lost.
        lost: ``(boot, first, last)`` of the messages given up.
    """

    position: Position
    reason: str
    time: tuple[int, int]
    messages: int
    samples: int
    lost: tuple[tuple[int, int, int], ...]

    @property
    def detail(self) -> str:
        """For people: the reason, and what was lost, if anything."""
        counts = ((self.messages, "message"), (self.samples, "sample"))
        lost = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
        return f"{self.reason}: {' and '.join(lost)} lost" if lost else self.reason

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump(
            position_fields(Kind.GAP, self.position)
            | {4: self.reason, 5: list(self.time), 6: self.messages, 7: self.samples}
            | {8: [list(span) for span in self.lost]}
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a gap.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a gap from its decoded fields."""
        fields.only(_FIELDS)
        return cls(
            position=read_position(fields),
            reason=fields.text(4, 100),
            time=fields.moments(5),
            messages=fields.integer(6, 0, MOST_COUNT),
            samples=fields.integer(7, 0, MOST_COUNT),
            lost=tuple(read_span(span, "field 8") for span in fields.items(8, _MOST_RANGES)),
        )


def read_span(value: object, what: str) -> tuple[int, int, int]:
    """Read ``[boot, first, last]``.

    Raises:
        MessageError: It is none.
    """
    numbers = [integer(number, what, 0, MOST_COUNT) for number in items(value, what, 3)]
    if len(numbers) != 3 or numbers[1] > numbers[2]:
        raise MessageError(f"{what} holds {numbers}; expected boot, first <= last")
    return numbers[0], numbers[1], numbers[2]
