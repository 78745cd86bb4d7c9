"""Segments of samples with one verdict: by tiles, else by samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Verdict
from eskin_cloud.query.tile_drilldown import TileDrilldown
from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.patch_columns import split_column

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window


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
        coverage: The least of its samples'.
    """

    start: int
    end: int
    answer: Verdict
    dt: int
    n: int
    held: int
    error: int
    coverage: float = 1.0

    def reaches(self, following: Segment) -> bool:
        """Whether no gap lies between this segment and the next."""
        return following.start - self.end <= self.dt + self.dt // 2

    def grow(self, following: Segment) -> None:
        """Append the next segment."""
        self.held += min(max(following.start - self.end, 0), self.dt) + following.held
        self.n += following.n
        self.error = max(self.error, following.error)
        self.coverage = min(self.coverage, following.coverage)
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
        channel: The channel.
        window: The window.
        question: The predicate.
    """
    drilldown = TileDrilldown(connection, channel, window, question)
    for part in drilldown.parts():
        if isinstance(part, tuple):
            pieces, answer = part
            yield from as_runs(pieces, [answer])
        else:
            yield from _of_samples(connection, channel, part, question)


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


def _of_samples(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[Segment]:
    for part in split_column(connection, channel, window):
        samples = read_samples(connection, channel, part)
        if len(samples):
            yield from parted(samples, question.answers(samples.lo, samples.hi))


def parted(pieces: Aggregates, answers: NDArray[np.int8]) -> Iterator[Segment]:
    """Segments of at least one entry, with one verdict and no gap each."""
    broken = pieces.first[1:] - pieces.last[:-1] > longest_step(pieces.dt[:-1])
    cut = np.concatenate([[False], (np.diff(answers) != 0) | broken])
    grouped = pieces.grouped(np.cumsum(cut, dtype=np.int64))
    yield from as_runs(grouped, answers[np.flatnonzero(np.diff(np.cumsum(cut), prepend=-1))])


def as_runs(pieces: Aggregates, answers: Iterable[int]) -> Iterator[Segment]:
    """A segment for each entry."""
    columns = (
        *(pieces.first, pieces.last, pieces.dt, pieces.n, pieces.held, pieces.error),
        pieces.coverage,
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for (first, last, *rest), answer in zip(rows, answers, strict=True):
        yield Segment(first, last, Verdict(int(answer)), *rest)


def find_segments(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Iterator[Segment]:
    """Segments with a certain or possible verdict, in order of time, none across a gap."""
    runs = merge(find_segments_of(connection, channel, window, question))
    return (run for run in runs if run.answer is not Verdict.IMPOSSIBLE)
