"""Batches that are stored as ingest stores them, several in one commit."""

from __future__ import annotations

from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from eskin_cloud.store.write.ingest import ingest
from eskin_cloud.store.write.ingest_individually import ingest_individually
from eskin_cloud.store.write.parsed_message import ParsedMessage

from tests.unit.cloud.messages import NODE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Said


def bring(
    store: Store,
    *said: Said,
    then: Callable[[Connection], object] | None = None,
    together: bool = True,
) -> Any:
    """Have messages stored as ingest has, in a batch that may do something more before its end."""
    items = [ParsedMessage.read(NODE, message.encode()) for message in said]

    def work(take: Callable[..., IngestResult], connection: Connection) -> IngestResult:
        now = store.clock()
        outcome = take(connection, store.cache, items, gateway="g", now=now, dead_letters=9)
        if then is not None:
            then(connection)
        return outcome

    ways = partial(work, ingest), partial(work, ingest_individually)
    return store.write(ways[0], instead=ways[1], together=together)


@contextmanager
def one_commit(store: Store) -> Iterator[None]:
    """What is to be written meanwhile waits, and then shares a commit."""
    started: Future[None] = Future()
    held: Future[None] = Future()

    def wait(_: Connection) -> None:
        started.set_result(None)
        held.result(120)

    first = store.write(wait)
    started.result(120)
    try:
        yield
    finally:
        held.set_result(None)
    first.result(120)


def kinds(outcome: IngestResult) -> list[str]:
    """What became of each item."""
    return [receipt.result for receipt in outcome.results]
