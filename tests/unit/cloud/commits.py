"""Batches that are stored as ingest stores them, several in one commit."""

from __future__ import annotations

from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from eskin_cloud.store.write.ingest import ingest, ingest_individually
from eskin_cloud.store.write.parsed_message import ParsedMessage

from eskin.wire.slot import slot_of
from tests.unit.cloud.clouds import present
from tests.unit.cloud.messages import NODE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult
    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Said


def bring(
    store: Store,
    *said: Said,
    then: Callable[[Connection], object] | None = None,
    shared: bool = True,
) -> Any:
    """Have messages stored as ingest has, in a batch that may do something more before its end."""
    items = [ParsedMessage.parse(NODE, message.encode()) for message in said]

    def work(
        take: Callable[..., IngestResult], connection: Connection, cache: WriteCache
    ) -> IngestResult:
        now = store.clock()
        present(connection, cache, items)
        outcome = take(connection, cache, items, gateway="g", now=now, dead_letters=9)
        if then is not None:
            then(connection)
        return outcome

    ways = partial(work, ingest), partial(work, ingest_individually)
    return store.write_slots([slot_of(NODE)], ways[0], fallback=ways[1], shared=shared)


@contextmanager
def one_commit(store: Store, node: str = NODE) -> Iterator[None]:
    """A transaction of a node's slot lasts meanwhile; writes that wait for it share a commit."""
    started: Future[None] = Future()
    held: Future[None] = Future()

    def wait(_: Connection, __: WriteCache) -> None:
        started.set_result(None)
        held.result(120)

    first = store.write_node(node, wait)
    started.result(120)
    try:
        yield
    finally:
        held.set_result(None)
    first.result(120)


def kinds(outcome: IngestResult) -> list[str]:
    """The result of each message."""
    return [receipt.result for receipt in outcome.results]
