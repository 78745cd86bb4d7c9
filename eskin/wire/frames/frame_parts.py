"""Parts of an encoded frame, without decoding its samples."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2

from eskin.errors import MessageError
from eskin.wire.frames.frame import Grid
from eskin.wire.messages.cbor_map import dump
from eskin.wire.messages.header import Kind, Position

if TYPE_CHECKING:
    from collections.abc import Container

_MAP_OF_9: Final = 0xA9
_HEAD_FIELDS: Final = 8


class FrameHead(NamedTuple):
    """What stands in a frame before its patches.

    Attributes:
        position: Boot and sequence.
        layout: Hash of the layout by which it is read.
        page: Number of its page in the layout.
        ticks: The node's clock at the first moment, ns since its start.
        time: Enclosure of the same moment, UTC ns.
        grids: When patches were sampled.
    """

    position: Position
    layout: bytes
    page: int
    ticks: int
    time: tuple[int, int]
    grids: tuple[Grid, ...]

    @property
    def stretch(self) -> tuple[int, int]:
        """Names the stretch of time within its node: the pages of a picture share it."""
        return self.position.boot, self.ticks


def read_head(data: bytes) -> FrameHead:
    """Read the head of a frame that was checked when it was stored.

    Raises:
        MessageError: It is no frame.
    """
    if data[:3] != bytes((_MAP_OF_9, 1, Kind.FRAME)):
        raise MessageError(f"message begins with {data[:3].hex()}; expected a frame")
    stream = BytesIO(data)
    stream.seek(1)
    decoder = cbor2.CBORDecoder(stream)
    try:
        fields: dict[Any, Any] = {decoder.decode(): decoder.decode() for _ in range(_HEAD_FIELDS)}
        position = Position(fields[2], fields[3])
        grids = tuple(Grid(*grid) for grid in fields[8])
        return FrameHead(position, fields[4], fields[5], fields[6], tuple(fields[7]), grids)
    except (cbor2.CBORError, LookupError, TypeError) as error:
        raise MessageError(f"frame has no head: {error}") from error


def replace_sequence(data: bytes, sequence: int) -> bytes:
    """A frame with another sequence number.

    Args:
        data: A frame that was checked when it was stored.
        sequence: The number, below 2^53.

    Raises:
        MessageError: It is no frame.
    """
    boot, old = read_head(data).position
    before = data[:4] + cbor2.dumps(boot) + b"\x03"
    return before + cbor2.dumps(sequence) + data[len(before) + len(cbor2.dumps(old)) :]


def select_patches(data: bytes, patches: Container[int]) -> bytes | None:
    """A frame with some of its patches, whose records are copied; ``None`` with none of them.

    Grids that no patch is left of are dropped, and the others renumbered, so that the encoding is
    the only one of its content.

    Args:
        data: A frame that was checked when it was stored.
        patches: Numbers in the layout.

    Raises:
        MessageError: It is no frame.
    """
    try:
        fields: dict[Any, Any] = cbor2.loads(data)
        records: list[list[Any]] = fields[9]
        kept = [record for record in records if record[0] in patches]
        used = list(dict.fromkeys(record[1] for record in kept))
        grids = [fields[8][grid] for grid in used]
    except (cbor2.CBORError, LookupError, TypeError) as error:
        raise MessageError(f"frame cannot be read: {error}") from error
    if not kept:
        return None
    if len(kept) == len(records):
        return data
    numbers = {grid: number for number, grid in enumerate(used)}
    for record in kept:
        record[1] = numbers[record[1]]
    return dump({**fields, 8: grids, 9: kept})
