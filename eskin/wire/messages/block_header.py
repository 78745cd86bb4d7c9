"""A block's fields without its samples: its place and its hull."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin.wire.messages.encoding import ENCODINGS, Encoding
from eskin.wire.messages.header import Position, read_channel, read_position

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

MOST_SAMPLES: Final = 1000
LONGEST_DT: Final = 10**12
"""Longest sampling period, in ns."""
UNIT_LENGTH: Final = 16
_FIELDS: Final = frozenset(range(1, 18))
_PLAIN: Final = frozenset(range(1, 15)) | {17}


class BlockSummary(NamedTuple):
    """A block without its samples; a tuple, because there are many.

    Attributes:
        position: Boot and sequence.
        channel: ``{taxel}.{quantity}``.
        ticks: The node's clock at the first sample, ns since its start.
        time: Enclosure of the first sample's moment, UTC ns.
        dt: Sampling period in ns.
        n: How many samples.
        unit: UCUM code.
        coverage: Probability with which each sample's interval encloses the truth.
        encoding: How the samples are written.
        widening: How much the encoding moved a bound outward at most, in ``unit``.
        bounds: Hull of all samples.
    """

    position: Position
    channel: str
    ticks: int
    time: tuple[int, int]
    dt: int
    n: int
    unit: str
    coverage: float
    encoding: Encoding
    widening: float
    bounds: tuple[float, float]

    @classmethod
    def read(cls, fields: Fields) -> BlockSummary:
        """Read it from a block's decoded fields; the reader of the samples checks ``bounds``.

        Raises:
            MessageError: They are no block's.
        """
        encoding = ENCODINGS[fields.integer(11, 0, len(ENCODINGS) - 1)]
        fields.only(_FIELDS if encoding is Encoding.Q16 else _PLAIN)
        return cls(
            position=read_position(fields),
            channel=read_channel(fields, 4),
            ticks=fields.integer(6, 0, MOST_COUNT),
            time=fields.moments(7),
            dt=fields.integer(8, 1, LONGEST_DT),
            n=fields.integer(9, 1, MOST_SAMPLES),
            unit=fields.text(5, UNIT_LENGTH),
            coverage=fields.real(10, 0.0, 1.0),
            encoding=encoding,
            widening=fields.real(17, 0.0),
            bounds=fields.interval(14),
        )

    @property
    def first_moment(self) -> int:
        """The middle of the first sample's time enclosure, UTC ns, rounded down."""
        return (self.time[0] + self.time[1]) // 2

    @property
    def time_error(self) -> int:
        """How far a sample's true moment may lie from the middle, in ns, rounded up."""
        return (self.time[1] - self.time[0] + 1) // 2

    @property
    def span(self) -> int:
        """From the first sample to the last, in ns."""
        return self.dt * (self.n - 1)
