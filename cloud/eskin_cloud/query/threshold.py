"""When a channel is in a state, certainly or possibly: segments, never drawn across a gap."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.query.predicate import Verdict
from eskin_cloud.query.segments import find_segments_of, merge

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.store.read.window import Window


def find_segments(
    connection: Connection, channel: RowMapping, window: Window, question: Predicate
) -> Iterator[Segment]:
    """The runs in which the answer is certain or possible, in order of time, none with a gap."""
    runs = merge(find_segments_of(connection, channel, window, question, over_gaps=False))
    return (run for run in runs if run.answer is not Verdict.IMPOSSIBLE)
