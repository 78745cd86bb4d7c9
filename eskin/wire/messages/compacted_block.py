"""A pack: neighbouring ``q16`` blocks of one channel as a store keeps them, in about a third.

No node sends it. Every block comes back byte for byte, so a pack promises what its blocks promise;
samples are read from it without going through the blocks.

One byte, ``FORM``, which no CBOR map begins with; the length of a head in 16 bits; the head, in
CBOR: channel, unit, boot, dt, coverage, how many blocks; what differs from block to block, as
differences (`eskin.kernels.varints`); each block's lower codes and what the upper are above them
(`eskin.kernels.delta_bitpacking`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import cbor2
import numpy as np

from eskin.errors import MessageError
from eskin.kernels.delta_bitpacking import (
    ORDERS,
    PADDING,
    pack_run,
    run_limit,
    unpack_bounds,
    unpack_run,
)
from eskin.kernels.varints import LONGEST, read_differences, write_varints
from eskin.wire.messages.cbor_map import Fields, dump
from eskin.wire.messages.encoding import SAFE_EXPONENT, Encoding, typed_codes
from eskin.wire.messages.header import Kind, Position, position_fields

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

FORM: Final = 1
"""The first byte."""
_SCALED: Final = 0xB1
"""A CBOR map of 17 pairs: a block with a scale."""
_BENT: Final = ("sequence", "cursor", "ticks", "t_lo", "t_hi")
"""What grows evenly from block to block: stored as second differences."""
_PLAIN: Final = ("received", "n", "exponent", "offset", "widening", "order", "order_above", "size")
_NAMES: Final = (*_BENT, *_PLAIN)
_BODY: Final = ("n", "order", "order_above", "size", "exponent", "offset")
_BODIES: Final = np.array([_NAMES.index(name) for name in _BODY])


class Kept(NamedTuple):
    """A block as it lies in the store.

    Attributes:
        data: Its bytes.
        cursor: Its place in the feed.
        received: When it came, UTC ns.
    """

    data: bytes
    cursor: int
    received: int


@dataclass(frozen=True, slots=True)
class Pack:
    """Neighbouring blocks of one channel and one boot.

    Attributes:
        channel: ``{taxel}.{quantity}``.
        unit: UCUM code.
        boot: Of all blocks.
        dt: Sampling period in ns.
        coverage: Of all samples.
    """

    channel: str
    unit: str
    boot: int
    dt: int
    coverage: float
    _table: NDArray[np.int64]
    _data: bytes
    _place: int

    @classmethod
    def read(cls, data: bytes) -> Self:
        """Read what `pack` wrote."""
        behind = 3 + int.from_bytes(data[1:3], "little")
        channel, unit, boot, dt, coverage, count = cbor2.loads(data[3:behind])
        table = np.empty((len(_NAMES), count), np.int64)
        padded = data + bytes(PADDING)
        place = read_differences(padded, behind, table, len(_BENT))
        return cls(channel, unit, boot, dt, coverage, table, padded, place)

    @property
    def n(self) -> NDArray[np.int64]:
        """How many samples each block has."""
        return self.column("n")

    @property
    def first_moments(self) -> NDArray[np.int64]:
        """The middle of each block's first sample's time enclosure, UTC ns, rounded down."""
        earliest, latest = self.column("t_lo"), self.column("t_hi")
        # Their sum may need 65 bits.
        return (earliest & latest) + ((earliest ^ latest) >> 1)

    @property
    def errors(self) -> NDArray[np.int64]:
        """How far a moment of each block may lie from its middle, in ns, rounded up."""
        return self.column("t_hi") - self.first_moments

    def column(self, name: str) -> NDArray[np.int64]:
        """Of all blocks: ``sequence``, ``cursor``, ``received``, ``t_lo``, ``t_hi`` or ``n``."""
        column: NDArray[np.int64] = self._table[_NAMES.index(name)]
        return column

    def bounds(self) -> tuple[Floats, Floats]:
        """The lower and the upper bounds of all samples."""
        blocks = self._table[_BODIES]
        lo, hi = np.empty((2, int(blocks[0].sum())))
        unpack_bounds(self._data, self._place, blocks, lo, hi)
        return lo, hi

    def blocks(self) -> list[Kept]:
        """The blocks as they were."""
        lo, hi = self.bounds()
        ends = np.cumsum(self.n)
        places, found = self._places().tolist(), []
        for k, (row, end) in enumerate(zip(self._table.T.tolist(), ends.tolist(), strict=True)):
            said = dict(zip(_NAMES, row, strict=True))
            part = slice(end - said["n"], end)
            data = self._block(said, places[k], (float(lo[part].min()), float(hi[part].max())))
            found.append(Kept(data, said["cursor"], said["received"]))
        return found

    def _block(self, said: dict[str, int], place: int, bounds: tuple[float, float]) -> bytes:
        codes = np.empty((2, said["n"]), np.uint16)
        behind = unpack_run(self._data, place, said["order"], codes[0])
        unpack_run(self._data, behind, said["order_above"], codes[1])
        codes[1] += codes[0]
        position = Position(self.boot, said["sequence"])
        fields: dict[int, object] = position_fields(Kind.BLOCK, position)
        fields |= {4: self.channel, 5: self.unit, 6: said["ticks"], 8: self.dt, 9: said["n"]}
        fields |= {7: [said["t_lo"], said["t_hi"]], 10: self.coverage, 11: int(Encoding.Q16)}
        fields |= {12: typed_codes(codes[0]), 13: typed_codes(codes[1]), 14: list(bounds)}
        fields |= {15: said["exponent"], 16: said["offset"], 17: _float(said["widening"])}
        return dump(fields)

    def _places(self) -> NDArray[np.int64]:
        sizes = self.column("size")
        return np.cumsum(sizes) - sizes + self._place


def pack(blocks: Sequence[Kept]) -> bytes:
    """Write blocks of one channel and boot as a pack.

    Raises:
        MessageError: They are not alike, not ``q16``, or would not come back byte for byte.
    """
    heads, rows, bodies = set(), [], []
    for kept in blocks:
        fields = Fields(cbor2.loads(kept.data))
        heads.add(tuple(fields.raw(key) for key in (4, 5, 2, 8, 10)))
        row, body = _pack_block(fields, kept)
        rows.append(row)
        bodies.append(body)
    if len(heads) != 1:
        raise MessageError("blocks of a pack have one channel, unit, boot, dt and coverage")
    head = cbor2.dumps([*heads.pop(), len(rows)])
    table = np.array([[row[name] for row in rows] for name in _NAMES], np.int64)
    table[: len(_BENT)] = np.diff(table[: len(_BENT)], axis=1, prepend=0)
    table = np.diff(table, axis=1, prepend=0)
    out = np.empty(table.size * LONGEST, np.uint8)
    numbers = out[: write_varints(table.ravel(), out)].tobytes()
    data = b"".join([bytes([FORM]), len(head).to_bytes(2, "little"), head, numbers, *bodies])
    if Pack.read(data).blocks() != list(blocks):
        raise MessageError("blocks would not come back from a pack byte for byte")
    return data


def is_pack(data: bytes) -> bool:
    """Whether what lies in a store is a pack, and no block."""
    return data[0] == FORM


def is_packable(data: bytes) -> bool:
    """Whether what lies in a store is a block of ``q16``, the only one that is packed."""
    return data[0] == _SCALED


def _pack_block(fields: Fields, kept: Kept) -> tuple[dict[str, int], bytes]:
    if fields.raw(11) != Encoding.Q16 or abs(fields.integer(15, -1074, 1023)) > SAFE_EXPONENT:
        raise MessageError("only q16 blocks of usual size are packed")
    lo, hi = (np.frombuffer(_bytes(fields, key), "<u2").astype(np.int64) for key in (12, 13))
    (order, lower), (order_above, above) = _shortest(lo), _shortest(hi - lo)
    t_lo, t_hi = fields.moments(7)
    row = {
        "sequence": fields.integer(3, 0, 2**53),
        "cursor": kept.cursor,
        "ticks": fields.integer(6, 0, 2**53),
        "t_lo": t_lo,
        "t_hi": t_hi,
        "received": kept.received,
        "n": lo.size,
        "exponent": fields.integer(15, -1074, 1023),
        "offset": fields.integer(16, -(2**53), 2**53),
        "widening": _bits(fields.real(17)),
        "order": order,
        "order_above": order_above,
        "size": len(lower) + len(above),
    }
    return row, lower + above


def _bytes(fields: Fields, key: int) -> bytes:
    array = fields.raw(key)
    return array.value if isinstance(array, cbor2.CBORTag) else b""


def _shortest(codes: NDArray[np.int64]) -> tuple[int, bytes]:
    """The order with which a run is shortest, and the run."""
    out = np.empty(run_limit(codes.size), np.uint8)
    found = ((order, out[: pack_run(codes, order, out)].tobytes()) for order in range(ORDERS))
    return min(found, key=lambda each: len(each[1]))


def _bits(value: float) -> int:
    return int(np.float64(value).view(np.int64))


def _float(bits: int) -> float:
    return float(np.int64(bits).view(np.float64))
