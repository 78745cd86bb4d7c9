"""The block: 1 to 1000 samples of one channel, the same bytes on the wire, in spool and store."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from eskin.errors import MessageError
from eskin.tube import Tube
from eskin.wire.messages.block_header import MOST_SAMPLES, BlockSummary
from eskin.wire.messages.cbor_map import dump, load
from eskin.wire.messages.encoding import (
    Encoding,
    Scale,
    decode_floats,
    decode_q16,
    encode_floats,
    encode_q16,
    require_scale,
)
from eskin.wire.messages.header import Kind, Position, position_fields, require_channel

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.wire.messages.cbor_map import Fields


@dataclass(frozen=True, slots=True)
class Block:
    """Samples of one channel with all that is needed to read them.

    Attributes:
        position: Boot and sequence.
        channel: ``{taxel}.{quantity}``.
        ticks: The node's clock at the first sample, ns since its start.
        tube: The samples as they were written (after outward rounding).
        encoding: How they are written.
        widening: How much the encoding moved a bound outward at most, in the channel's unit.
        bounds: Hull of all samples.
    """

    position: Position
    channel: str
    ticks: int
    tube: Tube
    encoding: Encoding
    widening: float
    bounds: tuple[float, float]
    _bytes: bytes

    @classmethod
    def pack(
        cls, position: Position, channel: str, ticks: int, tube: Tube, encoding: Encoding
    ) -> Self:
        """Write samples as a block.

        Raises:
            MessageError: No sample or more than 1000, or a channel's name that is none.
        """
        require_channel(channel, "channel")
        n = len(tube)
        if not 1 <= n <= MOST_SAMPLES:
            raise MessageError(f"a block holds 1 to {MOST_SAMPLES} samples, not {n}")
        fields: dict[int, object] = position_fields(Kind.BLOCK, position)
        if encoding is Encoding.Q16:
            scale = Scale.covering(tube.values)
            lo, hi = encode_q16(tube.values, scale)
            fields |= {15: scale.exponent, 16: scale.offset}
            written = decode_q16(lo, hi, n, scale)
        else:
            lo, hi = encode_floats(tube.values, encoding)
            written = decode_floats(lo, hi, n, encoding)
        widening = _widening(tube.values, written)
        fields |= {4: channel, 5: tube.unit, 6: ticks, 7: list(tube.time), 8: tube.dt, 9: n}
        fields |= {10: tube.coverage, 11: int(encoding), 12: lo, 13: hi}
        bounds = _hull(written)
        fields |= {14: list(bounds), 17: widening}
        kept = Tube(tube.time, tube.dt, written, tube.unit, tube.coverage)
        return cls(position, channel, ticks, kept, encoding, widening, bounds, dump(fields))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a block.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data), data)

    @classmethod
    def read(cls, fields: Fields, data: bytes) -> Self:
        """Read a block from its decoded fields."""
        said = BlockSummary.read(fields)
        lo, hi = fields.raw(12), fields.raw(13)
        if said.encoding is Encoding.Q16:
            values = decode_q16(lo, hi, said.n, require_scale(fields))
        else:
            values = decode_floats(lo, hi, said.n, said.encoding)
        if said.bounds != _hull(values):
            raise MessageError("field 14 is not the hull of the samples")
        return cls(
            position=said.position,
            channel=said.channel,
            ticks=said.ticks,
            tube=Tube(said.time, said.dt, values, said.unit, said.coverage),
            encoding=said.encoding,
            widening=said.widening,
            bounds=said.bounds,
            _bytes=data,
        )

    @property
    def summary(self) -> BlockSummary:
        """The same without its samples."""
        tube = self.tube
        return BlockSummary(
            position=self.position,
            channel=self.channel,
            ticks=self.ticks,
            time=tube.time,
            dt=tube.dt,
            n=len(tube),
            unit=tube.unit,
            coverage=tube.coverage,
            encoding=self.encoding,
            widening=self.widening,
            bounds=self.bounds,
        )

    def encode(self) -> bytes:
        """The bytes, always the same."""
        return self._bytes


def _hull(values: Interval) -> tuple[float, float]:
    return float(values.inf.min()), float(values.sup.max())


def _widening(exact: Interval, written: Interval) -> float:
    with np.errstate(invalid="ignore", over="ignore"):
        moved = np.concatenate([exact.inf - written.inf, written.sup - exact.sup])
    moved = moved[np.isfinite(moved)]
    most = float(moved.max()) if moved.size else 0.0
    return math.nextafter(most, math.inf) if most > 0.0 else 0.0
