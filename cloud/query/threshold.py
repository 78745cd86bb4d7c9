"""When a channel is above, or below, a value: certainly or possibly.

For ``above``: a sample is certain if its lower bound is above the value, possible if its upper
bound is, else impossible. A sample of which nothing is known is possible, too. Blocks whose bounds
lie on one side are answered by their bounds; only those that straddle the value are decoded.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import and_, case, select

from cloud.query.span import Samples, clip, gather, longest_step, touching
from cloud.store.schema import blocks
from eskin.messages import Block

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, RowMapping

    from cloud.query.window import Window
    from eskin.interval import Floats

_AT_ONCE: Final = 1000


class Answer(IntEnum):
    """Three honest answers."""

    IMPOSSIBLE = 0
    POSSIBLE = 1
    CERTAIN = 2


@dataclass(frozen=True, slots=True)
class Threshold:
    """The question.

    Attributes:
        value: In the channel's unit.
        above: Whether above is asked, else below.
    """

    value: float
    above: bool

    def answers(self, lo: Floats, hi: Floats) -> NDArray[np.int8]:
        """The answer for each interval."""
        certain = lo > self.value if self.above else hi < self.value
        possible = hi > self.value if self.above else lo < self.value
        return certain.astype(np.int8) + possible.astype(np.int8)

    def straddled(self) -> ColumnElement[bool]:
        """Whether a block's bounds leave the answer open."""
        b = blocks.c
        above, below = b.hi > self.value, b.lo < self.value
        return and_(above, b.lo <= self.value) if self.above else and_(below, b.hi >= self.value)

    def answer(self, lo: float, hi: float) -> Answer | None:
        """The answer for all samples within these bounds; ``None`` if they may differ."""
        certain = lo > self.value if self.above else hi < self.value
        possible = hi > self.value if self.above else lo < self.value
        if certain:
            return Answer.CERTAIN
        return None if possible else Answer.IMPOSSIBLE


@dataclass(slots=True)
class Segment:
    """A run of samples with the same answer and no gap between them.

    Attributes:
        start: The first sample's moment, UTC ns.
        end: The last sample's moment.
        answer: Their answer.
        step: The longest time to the next sample that is no gap.
    """

    start: int
    end: int
    answer: Answer
    step: int


def find_segments(
    connection: Connection, channel: RowMapping, window: Window, question: Threshold
) -> Iterator[Segment]:
    """The segments in which the answer is certain or possible, in order of time."""
    runs = _runs(connection, channel, window, question)
    return (segment for segment in _merge(runs) if segment.answer is not Answer.IMPOSSIBLE)


def _merge(runs: Iterable[Segment]) -> Iterator[Segment]:
    current: Segment | None = None
    for run in runs:
        if current is None:
            current = run
        elif run.answer is current.answer and run.start - current.end <= current.step:
            current.end, current.step = run.end, run.step
        else:
            yield current
            current = run
    if current is not None:
        yield current


def _runs(
    connection: Connection, channel: RowMapping, window: Window, question: Threshold
) -> Iterator[Segment]:
    for cluster in _clusters(connection, channel, window, question):
        row = cluster[0]
        answer = question.answer(row["lo"], row["hi"]) if len(cluster) == 1 else None
        if answer is not None:
            first, last = clip(row["t"], row["dt"], row["n"], window)
            if first <= last:
                step = row["dt"] + row["dt"] // 2
                yield Segment(
                    row["t"] + first * row["dt"], row["t"] + last * row["dt"], answer, step
                )
        else:
            yield from _decoded(gather(_decode(connection, cluster), window), question)


def _clusters(
    connection: Connection, channel: RowMapping, window: Window, question: Threshold
) -> Iterator[list[RowMapping]]:
    """Blocks in order of time; those that overlap each other come together.

    Bytes come along only with blocks that straddle the value.
    """
    b = blocks.c
    data = case((question.straddled(), b.data), else_=None).label("data")
    query = select(b.boot, b.sequence, b.t, b.t_end, b.n, b.dt, b.lo, b.hi, b.node, data)
    query = query.where(touching(channel, window)).order_by(b.t, b.boot, b.sequence)
    cluster: list[RowMapping] = []
    end = 0
    for row in connection.execute(query).mappings().yield_per(_AT_ONCE):
        if cluster and row["t"] > end:
            yield cluster
            cluster = []
        end = max(end, row["t_end"]) if cluster else row["t_end"]
        cluster.append(row)
    if cluster:
        yield cluster


def _decode(connection: Connection, cluster: list[RowMapping]) -> Iterator[Block]:
    for row in cluster:
        if row["data"] is not None:
            yield Block.decode(row["data"])
            continue
        where = (
            blocks.c.node == row["node"],
            blocks.c.boot == row["boot"],
            blocks.c.sequence == row["sequence"],
        )
        yield Block.decode(connection.execute(select(blocks.c.data).where(*where)).scalar_one())


def _decoded(samples: Samples, question: Threshold) -> Iterator[Segment]:
    if samples.t.size == 0:
        return
    answers = question.answers(samples.lo, samples.hi)
    cut = np.flatnonzero((np.diff(answers) != 0) | samples.breaks)
    firsts = np.concatenate([[0], cut + 1])
    lasts = np.concatenate([cut, [samples.t.size - 1]])
    steps = longest_step(samples.dt[lasts])
    for first, last, step in zip(firsts, lasts, steps, strict=True):
        answer = Answer(int(answers[first]))
        yield Segment(int(samples.t[first]), int(samples.t[last]), answer, int(step))
