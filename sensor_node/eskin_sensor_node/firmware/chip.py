"""The storage chip as the control unit sees it: messages by position, changed in transactions."""


class StoredMessage:
    """A message that waits.

    Attributes:
        position: Its boot and sequence.
        kind: As in `eskin_sensor_node.firmware.message_writer`.
        body: Its plaintext.
        time: UTC ns, earliest and latest instant that it covers.
        samples: How many samples go with it.
        messages: How many it stands for: itself, and those that a gap names.
    """

    __slots__ = ("body", "kind", "messages", "position", "samples", "time")

    def __init__(
        self,
        position: "Position",
        kind: int,
        body: bytes,
        time: "tuple[int, int]",
        samples: int,
        messages: int,
    ) -> None:
        self.position = position
        self.kind = kind
        self.body = body
        self.time = time
        self.samples = samples
        self.messages = messages


TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Protocol

    from eskin_sensor_node.firmware.message_writer import Record

    Position = tuple[int, int]
    """Boot and sequence."""

    class Chip(Protocol):
        """Keeps messages; it decides nothing.

        Every method may raise the machine's own error where the chip fails. Nothing of a
        transaction stays that was rolled back, or that a loss of power interrupted.
        """

        @property
        def boot(self) -> int:
            """Number of this start; counted, durably, before anyone can use it."""

        def restart(self) -> None:
            """Count another boot, durably; if that fails, the number stays as it was."""

        def begin(self) -> None:
            """Begin a transaction."""

        def commit(self) -> None:
            """End it; when this returns, it is durable."""

        def roll_back(self) -> None:
            """Undo it, if one is open."""

        def append(self, boot: int, record: Record, priority: int) -> None:
            """Store a message."""

        def delete(self, boot: int, first: int, last: int) -> tuple[int, int]:
            """Delete from the first to the last sequence; gives how many, and their bytes."""

        def read(self, position: Position) -> StoredMessage | None:
            """One message; None if it is gone."""

        def after(self, position: Position, limit: int) -> list[StoredMessage]:
            """The next messages behind a position, in order."""

        def oldest(self, priority: int) -> StoredMessage | None:
            """The first message of a priority; None if it is empty."""

        def level(self) -> tuple[int, int]:
            """How many messages it keeps, and their bytes."""

        def gaps(self) -> int:
            """How many gaps were ever recorded."""

        def store_counts(self, gaps: int, last: int) -> None:
            """Keep that number, and the greatest sequence that this boot has given out."""

        def ended(self) -> list[Position]:
            """The latest former boots (at most 8) that kept one, with it, in order."""

        def answer(self) -> bytes | None:
            """The last result, also after it was acknowledged."""

        def store_answer(self, body: bytes) -> None:
            """Keep the last result apart from the messages."""

        def store_descriptions(self, layout: bytes, descriptions: dict[bytes, bytes]) -> None:
            """Keep descriptions by their hashes, apart from messages, and no others.

            Those that are kept already stay while messages wait, which may be read by them.
            ``layout`` is the hash of the layout by which this boot's frames are read.
            """

        def descriptions(self) -> list[bytes]:
            """The hashes of all that it keeps, in the order of their first keeping."""

        def description(self, name: bytes) -> bytes | None:
            """The description of a hash; None if it is not there."""

        def charge(self) -> bytes:
            """What was kept of the supply; empty where nothing was."""

        def store_charge(self, body: bytes) -> None:
            """Keep that."""
