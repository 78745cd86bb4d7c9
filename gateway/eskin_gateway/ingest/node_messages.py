"""All that a node sends, and how it is decoded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from eskin.errors import MessageError
from eskin.wire.frames import FrameSummary, Layout, Patch, Statements
from eskin.wire.messages import Kind, Result, Status
from eskin.wire.messages.cbor_map import load

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.wire.messages import Position


class EncodedFrame(NamedTuple):
    """A frame whose samples were checked, not kept.

    Attributes:
        summary: What it holds besides samples.
        data: The frame.
    """

    summary: FrameSummary
    data: bytes

    @property
    def position(self) -> Position:
        """Boot and sequence."""
        return self.summary.position

    @property
    def layout(self) -> bytes:
        """Hash of the layout by which it is read."""
        return self.summary.layout


Described: TypeAlias = EncodedFrame | Statements
"""A message that names a layout."""
Numbered: TypeAlias = Status | Result | Described
"""A message with a position."""

_DECODERS: Final[dict[int, Callable[[bytes], Numbered | Patch | Layout]]] = {
    Kind.STATUS: Status.decode,
    Kind.RESULT: Result.decode,
    Kind.FRAME: lambda data: EncodedFrame(FrameSummary.decode(data), data),
    Kind.STATEMENTS: Statements.decode,
    Kind.PATCH: Patch.decode,
    Kind.LAYOUT: Layout.decode,
}


def decode(plaintext: bytes) -> Numbered | Patch | Layout:
    """Decode a message; a frame without its samples, which are checked.

    Raises:
        MessageError: It is none.
    """
    # Field 1, the kind, is the first of a map whose head has one byte.
    kind = plaintext[2] if len(plaintext) > 2 and plaintext[1] == 1 else 0
    decoder = _DECODERS.get(kind)
    if decoder is None:
        kind = load(plaintext).integer(1, 0, 255)
        raise MessageError(f"field 1 is {kind}; a node sends kinds {sorted(map(int, _DECODERS))}")
    return decoder(plaintext)
