"""Taking in what can be of a batch in which something broke that nobody foresaw."""

from __future__ import annotations

import logging
from itertools import chain
from typing import TYPE_CHECKING

from sqlalchemy.exc import SQLAlchemyError

from eskin_cloud.store.db_errors import explain, is_of_the_store
from eskin_cloud.store.write.ingest import IngestResult, ingest
from eskin_cloud.store.write.missing_messages import note_lost
from eskin_cloud.store.write.parsed_message import ParsedMessage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.store.write.write_cache import WriteCache

log = logging.getLogger(__name__)


def ingest_individually(
    connection: Connection,
    cache: WriteCache,
    items: Sequence[ParsedMessage],
    *,
    gateway: str,
    site: str | None = None,
    now: int,
    dead_letters: int,
) -> IngestResult:
    """Store a batch within a transaction, each item for itself; what breaks becomes a dead letter.

    Else its gateway would bring the same batch for ever, and all that waits behind it with it.
    Arguments and answer are those of `ingest`.
    """

    def take(item: ParsedMessage) -> IngestResult:
        outcome = ingest(
            connection,
            cache,
            [item],
            gateway=gateway,
            site=site,
            now=now,
            dead_letters=dead_letters,
        )
        cache.save(connection)  # with the next one, all that is not saved may be forgotten
        return outcome

    def take_or_bury(item: ParsedMessage) -> IngestResult:
        savepoint = connection.begin_nested()
        try:
            outcome = take(item)
        except Exception as error:
            if is_of_the_store(error):
                raise
            savepoint.rollback()
            cache.forget()
            log.exception(
                "message broke the store's work: node=%s bytes=%d", item.node, len(item.data)
            )
            if item.message is not None:
                boot, sequence = item.message.position
                note_lost(connection, item.node, [(boot, sequence, sequence)])
            return take(
                ParsedMessage.refused(item.node, item.data, f"it cannot be stored: {_told(error)}")
            )
        savepoint.commit()
        return outcome

    outcomes = [take_or_bury(item) for item in items]
    lags = [outcome.lag for outcome in outcomes if outcome.lag is not None]
    return IngestResult(
        results=list(chain.from_iterable(outcome.results for outcome in outcomes)),
        entries=list(chain.from_iterable(outcome.entries for outcome in outcomes)),
        buried=sum(outcome.buried for outcome in outcomes),
        lag=lags[-1] if lags else None,
        conflicts=sum(outcome.conflicts for outcome in outcomes),
    )


def _told(error: Exception) -> str:
    """An error without the values that it may quote: a dead letter's reason is read by others."""
    name = type(error).__name__
    return f"{name}: {explain(error)}" if isinstance(error, SQLAlchemyError) else name
