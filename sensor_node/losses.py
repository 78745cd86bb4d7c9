"""What a node had to give up, gathered until a gap message can say it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from eskin.messages import Gap, Position
from eskin.sequences import SequenceRanges

MOST_SPANS: Final = 64
"""Ranges of positions that one gap message can name."""


@dataclass(slots=True)
class Loss:
    """Messages or samples lost for one reason.

    Attributes:
        reason: Such as ``flash full``.
        time: UTC ns, earliest and latest moment that is affected.
        messages: How many messages.
        samples: How many samples, over all channels.
        lost: Boot to the sequences lost.
    """

    reason: str
    time: tuple[int, int] | None = None
    messages: int = 0
    samples: int = 0
    lost: dict[int, SequenceRanges] = field(default_factory=dict)

    def take(
        self,
        *,
        time: tuple[int, int],
        samples: int,
        position: Position | None = None,
        messages: int = 1,
    ) -> None:
        """Count in samples that were never taken, or a message.

        Args:
            time: UTC ns, from the earliest to the latest moment that it tells of.
            samples: How many samples it holds.
            position: The message's; ``None`` where there is none.
            messages: How many the message stands for: a gap stands for those that it names, too.
        """
        known = self.time or time
        self.time = min(known[0], time[0]), max(known[1], time[1])
        self.samples += samples
        if position is not None:
            self.messages += messages
            self.lost.setdefault(position.boot, SequenceRanges()).add(position.sequence)

    def skip(self, position: Position) -> None:
        """Count in a position that was given out for nothing, so that its neighbours melt."""
        self.lost.setdefault(position.boot, SequenceRanges()).add(position.sequence)

    @property
    def full(self) -> bool:
        """Whether one gap message might not name one position more."""
        return sum(len(ranges) for ranges in self.lost.values()) >= MOST_SPANS

    def gap(self, position: Position) -> Gap:
        """Say it."""
        spans = [
            (boot, first, last)
            for boot, ranges in sorted(self.lost.items())
            for first, last in ranges
        ]
        return Gap(
            position=position,
            reason=self.reason,
            time=self.time or (0, 0),
            messages=self.messages,
            samples=self.samples,
            lost=_named(spans),
        )


def _named(spans: list[tuple[int, int, int]]) -> tuple[tuple[int, int, int], ...]:
    """As many ranges as a gap message can name; the last takes in what lies behind it."""
    if len(spans) > MOST_SPANS:
        rest = spans[MOST_SPANS - 1 :]
        last_boot = [span for span in rest if span[0] == rest[0][0]]
        spans = [*spans[: MOST_SPANS - 1], (rest[0][0], rest[0][1], last_boot[-1][2])]
    return tuple(spans)
