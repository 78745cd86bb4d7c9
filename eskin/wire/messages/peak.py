"""A peak on the wire: certain, or a region with a number of possible ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from eskin.interval import Verdict
from eskin.wire.messages.cbor_map import dump, load
from eskin.wire.messages.header import Kind, Position, position_fields, read_channel, read_position

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

_FIELDS: Final = frozenset(range(1, 12))


@dataclass(frozen=True, slots=True)
class Peak:
    """See `eskin.peaks.PeakEvent`; with absolute time, and of the signal as its node smooths it.

    Attributes:
        position: Boot and sequence.
        channel: ``{taxel}.{quantity}``.
        unit: UCUM code of height and prominence.
        time: UTC ns, from the earliest moment of sample a to the latest of sample c.
        verdict: Certain or possible.
        count: Fewest and most peaks.
        height: Enclosure of the greatest value in that time.
        prominence: Enclosure of the prominence.
        coverage: Probability of the whole statement: the union bound over its samples.
    """

    position: Position
    channel: str
    unit: str
    time: tuple[int, int]
    verdict: Verdict
    count: tuple[int, int]
    height: tuple[float, float]
    prominence: tuple[float, float]
    coverage: float

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump(
            position_fields(Kind.PEAK, self.position)
            | {4: self.channel, 5: self.unit, 6: list(self.time), 7: int(self.verdict)}
            | {8: list(self.count), 9: list(self.height), 10: list(self.prominence)}
            | {11: self.coverage}
        )

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a peak.

        Raises:
            MessageError: It is none.
        """
        return cls.read(load(data))

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a peak from its decoded fields."""
        fields.only(_FIELDS)
        return cls(
            position=read_position(fields),
            channel=read_channel(fields, 4),
            unit=fields.text(5, 16),
            time=fields.moments(6),
            verdict=Verdict(fields.integer(7, Verdict.POSSIBLE, Verdict.CERTAIN)),
            count=fields.counts(8),
            height=fields.interval(9),
            prominence=fields.interval(10),
            coverage=fields.real(11, 0.0, 1.0),
        )
