"""Segments of samples with one verdict: by tiles, else blocks' bounds, else samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import case, select, tuple_

from eskin.interval import Verdict
from eskin_cloud.query.tile_drilldown import TileDrilldown
from eskin_cloud.rollup.blocks import DECODED, decode, read_samples
from eskin_cloud.store.damage import intact_headers
from eskin_cloud.store.read.block_index import HEADER_COLUMNS, longest_step, overlaps
from eskin_cloud.store.read.patch_columns import is_column, split_column
from eskin_cloud.store.read.window import clip
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

_AT_ONCE: Final = 1000


@dataclass(slots=True)
class Segment:
    """Consecutive samples with one verdict.

    Attributes:
        start: Time of the first sample, UTC ns.
        end: Time of the last sample.
        answer: The verdict.
        dt: Period of the last sample, ns.
        n: Number of samples.
        held: Total validity of all but the last sample, ns: each until the next, a period at most.
        error: Greatest distance of a sample's true time from its stated time, ns.
    """

    start: int
    end: int
    answer: Verdict
    dt: int
    n: int
    held: int
    error: int

    def reaches(self, following: Segment) -> bool:
        """Whether no gap lies between this segment and the next."""
        return following.start - self.end <= self.dt + self.dt // 2

    def grow(self, following: Segment) -> None:
        """Append the next segment."""
        self.held += min(max(following.start - self.end, 0), self.dt) + following.held
        self.n += following.n
        self.error = max(self.error, following.error)
        self.end, self.dt = following.end, following.dt


def find_segments_of(
    connection: Connection,
    channel: Channel,
    window: Window,
    question: Predicate,
) -> Iterator[Segment]:
    """All segments of a window, in order of time; neighbours may have the same verdict.

    Args:
        connection: In a read transaction.
        channel: The channel's row.
        window: The window.
        question: The predicate.
    """
    rest = _of_column if is_column(channel) else _of_blocks
    drilldown = TileDrilldown(connection, channel, window, question)
    for part in drilldown.parts():
        if isinstance(part, tuple):
            pieces, answer = part
            yield from as_runs(pieces, [answer])
        else:
            yield from rest(connection, channel, part, question)


def merge(runs: Iterable[Segment]) -> Iterator[Segment]:
    """Merge neighbours with the same verdict and no gap between them."""
    current: Segment | None = None
    for run in runs:
        if current is None:
            current = run
        elif run.answer is current.answer and current.reaches(run):
            current.grow(run)
        else:
            yield current
            current = run
    if current is not None:
        yield current


def _of_column(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[Segment]:
    for part in split_column(connection, channel, window):
        yield from _of_samples(read_samples(connection, channel, part), question)


def _of_blocks(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[Segment]:
    for cluster in _clusters(connection, channel, window, question):
        row = cluster[0]
        answer = question.answer(row["lo"], row["hi"]) if len(cluster) == 1 else None
        if answer is None:
            yield from _of_samples(_samples(connection, cluster, window), question)
            continue
        t, dt = row["t"], row["dt"]
        first, last = clip(t, dt, row["n"], window)
        if first <= last:
            span = (last - first) * dt
            begin, n = t + first * dt, last - first + 1
            yield Segment(begin, begin + span, answer, dt, n, span, row["error"])


def _clusters(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[list[RowMapping]]:
    """Groups of blocks in order of time; overlapping blocks are in one group.

    Only undecided blocks are read with their bytes.
    """
    b = blocks.c
    straddled = question.possible(b.lo, b.hi) & ~question.certain(b.lo, b.hi)
    data = case((straddled, b.data), else_=None).label("data")
    query = select(*HEADER_COLUMNS, data)
    query = query.where(overlaps(channel, window)).order_by(b.t, b.boot, b.sequence)
    cluster: list[RowMapping] = []
    end = 0
    for row in intact_headers(connection.execute(query).mappings().yield_per(_AT_ONCE)):
        if cluster and row["t"] > end:
            yield cluster
            cluster = []
        end = max(end, row["t_end"]) if cluster else row["t_end"]
        cluster.append(row)
    if cluster:
        yield cluster


def _samples(connection: Connection, cluster: list[RowMapping], window: Window) -> Aggregates:
    """The samples of a cluster."""
    b = blocks.c
    if all(row["data"] is not None for row in cluster):
        return decode([[row[c.name] for c in DECODED] for row in cluster], window)
    keys = [(row["node"], row["boot"], row["sequence"]) for row in cluster]
    query = select(*DECODED).where(tuple_(b.node, b.boot, b.sequence).in_(keys))
    rows = connection.execute(query.order_by(b.t, b.boot, b.sequence))
    return decode(rows.all(), window)


def _of_samples(samples: Aggregates, question: Predicate) -> Iterator[Segment]:
    if len(samples) == 0:
        return
    yield from parted(samples, question.answers(samples.lo, samples.hi))


def parted(pieces: Aggregates, answers: NDArray[np.int8]) -> Iterator[Segment]:
    """Segments of at least one entry, with one verdict and no gap each."""
    broken = pieces.first[1:] - pieces.last[:-1] > longest_step(pieces.dt[:-1])
    cut = np.concatenate([[False], (np.diff(answers) != 0) | broken])
    grouped = pieces.grouped(np.cumsum(cut, dtype=np.int64))
    yield from as_runs(grouped, answers[np.flatnonzero(np.diff(np.cumsum(cut), prepend=-1))])


def as_runs(pieces: Aggregates, answers: Iterable[int]) -> Iterator[Segment]:
    """A segment for each entry."""
    columns = (pieces.first, pieces.last, pieces.dt, pieces.n, pieces.held, pieces.error)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for (first, last, *rest), answer in zip(rows, answers, strict=True):
        yield Segment(first, last, Verdict(int(answer)), *rest)


def find_segments(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[Segment]:
    """Segments with a certain or possible verdict, in order of time, none across a gap."""
    runs = merge(find_segments_of(connection, channel, window, question))
    return (run for run in runs if run.answer is not Verdict.IMPOSSIBLE)
