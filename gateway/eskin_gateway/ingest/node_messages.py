"""All that a node sends, and how it is decoded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

from eskin.wire.frames import Frame, Layout, Patch, Statements
from eskin.wire.messages import Kind, Summary, decode_summary

if TYPE_CHECKING:
    from collections.abc import Callable

Numbered: TypeAlias = Summary | Frame | Statements
"""A message with a position."""
Described: TypeAlias = Frame | Statements
"""A message that names a layout."""

_DECODERS: Final[dict[int, Callable[[bytes], Described | Patch | Layout]]] = {
    Kind.FRAME: Frame.decode,
    Kind.STATEMENTS: Statements.decode,
    Kind.PATCH: Patch.decode,
    Kind.LAYOUT: Layout.decode,
}


def decode(plaintext: bytes) -> Numbered | Patch | Layout:
    """Decode a message; a block without its samples.

    A frame's samples are decoded, because their hulls are published: 0.3 of 0.5 ms for 9,600.

    Raises:
        MessageError: It is none.
    """
    # Field 1, the kind, is the first of a map whose head has one byte.
    kind = plaintext[2] if len(plaintext) > 2 and plaintext[1] == 1 else 0
    decoder = _DECODERS.get(kind)
    return decode_summary(plaintext) if decoder is None else decoder(plaintext)
