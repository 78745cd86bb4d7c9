"""A storage chip in memory, which can be made to fail; runs under CPython and MicroPython alike."""

from eskin_sensor_node.firmware.chip import StoredMessage

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import Position
    from eskin_sensor_node.firmware.message_writer import Record


class MemoryChip:
    """Keeps messages as long as it lives.

    Attributes:
        boot: Number of this start.
        failing: Whether commits fail.
    """

    def __init__(self) -> None:
        self.boot = 1
        self.failing = False
        self._messages: dict[Position, tuple[int, StoredMessage]] = {}
        self._gaps = 0
        self._answer: bytes | None = None
        self._charge = b""
        self._ended: dict[int, int] = {}
        self._before: (
            tuple[dict[Position, tuple[int, StoredMessage]], int, bytes | None, dict[int, int]]
            | None
        ) = None

    def restart(self) -> None:
        """Lose power and get it back."""
        self.roll_back()
        self.boot += 1

    def begin(self) -> None:
        assert self._before is None, "a transaction inside of another"
        self._before = dict(self._messages), self._gaps, self._answer, dict(self._ended)

    def commit(self) -> None:
        if self.failing:
            raise OSError("worn out")
        assert self._before is not None
        self._before = None

    def roll_back(self) -> None:
        if self._before is not None:
            self._messages, self._gaps, self._answer, self._ended = self._before
            self._before = None

    def append(self, boot: int, record: "Record", shelf: int) -> None:
        assert self._before is not None
        position = boot, record.sequence
        assert position not in self._messages, "one number given out twice"
        time, body = (record.earliest, record.latest), bytes(record.body)
        kept = StoredMessage(position, record.kind, body, time, record.samples, 1 + record.named)
        self._messages[position] = shelf, kept

    def delete(self, boot: int, first: int, last: int) -> "tuple[int, int]":
        assert self._before is not None
        gone = [p for p in self._messages if p[0] == boot and first <= p[1] <= last]
        freed = sum(len(self._messages.pop(position)[1].body) for position in gone)
        return len(gone), freed

    def read(self, position: "Position") -> "StoredMessage | None":
        found = self._messages.get(position)
        return None if found is None else found[1]

    def after(self, position: "Position", limit: int) -> "list[StoredMessage]":
        behind = sorted(each for each in self._messages if each > position)
        return [self._messages[each][1] for each in behind[:limit]]

    def oldest(self, shelf: int) -> "StoredMessage | None":
        own = [position for position, (where, _) in self._messages.items() if where == shelf]
        return self._messages[min(own)][1] if own else None

    def level(self) -> "tuple[int, int]":
        return len(self._messages), sum(len(kept.body) for _, kept in self._messages.values())

    def gaps(self) -> int:
        return self._gaps

    def store_counts(self, gaps: int, last: int) -> None:
        assert self._before is not None
        self._gaps = gaps
        self._ended[self.boot] = last

    def ended(self) -> "list[Position]":
        former = sorted(each for each in self._ended.items() if each[0] < self.boot)
        return former[-8:]

    def answer(self) -> "bytes | None":
        return self._answer

    def store_answer(self, body: bytes) -> None:
        assert self._before is not None
        self._answer = body

    def charge(self) -> bytes:
        return self._charge

    def store_charge(self, body: bytes) -> None:
        assert self._before is not None
        self._charge = body

    def store_descriptions(self, layout: bytes, descriptions: "dict[bytes, bytes]") -> None:
        raise NotImplementedError  # these scripts describe nothing: the host's tests do

    def descriptions(self) -> "list[bytes]":
        return []

    def description(self, name: bytes) -> "bytes | None":
        raise NotImplementedError  # asked for those of `descriptions` only: none
