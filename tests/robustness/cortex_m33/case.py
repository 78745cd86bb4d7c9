"""A call of one operation: what it is given and what it must give, as the C program reads it."""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import ModuleType

INTEGER, REAL, INTEGERS, REALS, BYTES = range(5)
_NAME: Final = 16
_CODES: Final = {INTEGER: "i", REAL: "d", INTEGERS: "i", REALS: "d"}
PREFIX: Final = "measure_"


@dataclass(slots=True)
class Case:
    """One call.

    Attributes:
        name: Of the operation.
        items: What it takes: a kind, and as many values.
        expected: All its arrays as they must be afterwards, in their order.
    """

    name: str
    items: list[tuple[int, bytes, int]] = field(default_factory=list)
    expected: list[bytes] = field(default_factory=list)

    @classmethod
    def of(cls, name: str, *given: Any, after: Sequence[Any] | None = None) -> Case:
        """A call with these arguments; ``after``: its arrays, where they change."""
        case = cls(name)
        for value in given:
            case.take(value)
        case.expected = [_content(each)[1] for each in given if _is_array(each)]
        if after is not None:
            case.expected = [_content(each)[1] for each in after]
        return case

    def take(self, value: Any) -> None:
        """Add an argument; a tuple's parts one after the other."""
        if isinstance(value, tuple):
            for each in value:
                self.take(each)
            return
        kind, content, length = _content(value)
        self.items.append((kind, content, length))

    def encode(self) -> bytes:
        """As the program reads it."""
        parts = [self.name.encode().ljust(_NAME, b"\0")]
        for kind, content, length in self.items:
            padding = bytes(-len(content) % 8)
            parts.append(struct.pack("<II", kind, length) + content + padding)
        return b"".join(parts)

    @property
    def size(self) -> int:
        """Bytes of its result behind the timer's ticks."""
        return sum(map(len, self.expected))


class Recorder:
    """`eskin_sensor_node.firmware.inversion`, of which every call becomes a case.

    Args:
        functions: The module.

    Attributes:
        cases: All calls so far.
    """

    def __init__(self, functions: ModuleType) -> None:
        self._functions = functions
        self.cases: list[Case] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(self._functions, name)

        def recorded(*given: Any) -> Any:
            case = Case.of(name.removeprefix(PREFIX), *given)
            result = function(*given)
            case.expected = [_content(each)[1] for each in given if _is_array(each)]
            self.cases.append(case)
            return result

        return recorded


def reals(values: Iterable[float]) -> array[float]:
    """An array of floats that an operation may fill."""
    return array("d", values)


def _is_array(value: Any) -> bool:
    return isinstance(value, array | list | bytes | bytearray)


def _content(value: Any) -> tuple[int, bytes, int]:
    """Kind, bytes and length of an argument."""
    if isinstance(value, bytes | bytearray):
        return BYTES, bytes(value), len(value)
    if isinstance(value, array | list):
        whole = value.typecode != "d" if isinstance(value, array) else type(value[0]) is int
        kind = INTEGERS if whole else REALS
        return kind, array(_CODES[kind], value).tobytes(), len(value)
    kind = INTEGER if isinstance(value, int) else REAL
    return kind, struct.pack("<" + _CODES[kind], value), 1
