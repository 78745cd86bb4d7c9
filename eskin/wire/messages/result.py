"""A result on the wire: what became of the last command, and how the node is set."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import MOST_COUNT, dump, load, read_map, read_texts, sort_texts
from eskin.wire.messages.command import is_place
from eskin.wire.messages.header import Kind, Position, position_fields, read_position

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields
    from eskin.wire.messages.command import State

MOST_REASON: Final = 200
_FIELDS: Final = frozenset(range(1, 9))
_MOST_PLACES: Final = 1000
_MOST_SETTINGS: Final = 16


class Outcome(IntEnum):
    """What became of a command."""

    DONE = 0
    REFUSED = 1
    EXPIRED = 2


@dataclass(frozen=True, slots=True)
class Result:
    """A node's answer to a command. At each start it says the last one again, with its state.

    Attributes:
        position: Boot and sequence.
        time: Enclosure of the moment, UTC ns.
        command: Id of the last command that the node took; 0 if there never was one.
        outcome: What became of it.
        reason: Why it was not done; ``None`` if it was.
        state: How the node is set now.
    """

    position: Position
    time: tuple[int, int]
    command: int
    outcome: Outcome
    reason: str | None
    state: State

    def encode(self) -> bytes:
        """Write as CBOR."""
        state = sort_texts({place: sort_texts(found) for place, found in self.state.items()})
        said: dict[int, object] = {} if self.reason is None else {7: self.reason}
        return dump(
            position_fields(Kind.RESULT, self.position)
            | {4: list(self.time), 5: self.command, 6: int(self.outcome), 8: state}
            | said
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a result.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a result from its decoded fields."""
        fields.only(_FIELDS)
        outcome = Outcome(fields.integer(6, 0, len(Outcome) - 1))
        if fields.has(7) is (outcome is Outcome.DONE):
            raise MessageError("field 7, the reason, stands where a command was not done")
        return cls(
            position=read_position(fields),
            time=fields.moments(4),
            command=fields.integer(5, 0, MOST_COUNT),
            outcome=outcome,
            reason=fields.text(7, MOST_REASON) if fields.has(7) else None,
            state=read_state(fields.raw(8)),
        )


def read_state(value: object) -> State:
    """Read the settings of each place.

    Raises:
        MessageError: It is no such map.
    """
    places = read_map(value, "field 8", _MOST_PLACES)
    for place in places:
        if not is_place(place):
            raise MessageError(
                f"field 8 speaks of {place!r}; expected a taxel, a channel, a monitor or *"
            )
    return {
        place: read_texts(found, f"field 8, {place}", _MOST_SETTINGS)
        for place, found in places.items()
    }
