"""When a channel is in a state, certainly or possibly: segments, never drawn across a gap."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cloud.query.question import Answer
from cloud.query.runs import find_runs, merge

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from cloud.query.question import Question
    from cloud.query.runs import Run
    from cloud.query.window import Window


def find_segments(
    connection: Connection, channel: RowMapping, window: Window, question: Question
) -> Iterator[Run]:
    """The runs in which the answer is certain or possible, in order of time, none with a gap."""
    runs = merge(find_runs(connection, channel, window, question, over_gaps=False))
    return (run for run in runs if run.answer is not Answer.IMPOSSIBLE)
