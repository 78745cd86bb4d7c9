"""Ingest: gateways bring what nodes said."""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from cloud.dependencies import CloudState
from cloud.ingest.batch import read_batch
from cloud.ingest.reception import apart, received
from cloud.ingest.warrant import Warrant, used_before
from cloud.problems import documented
from cloud.routes.answers import as_json
from cloud.routes.documents import CBOR_BODY, IngestDocument
from cloud.state import Cloud
from cloud.store.gateways import hear
from cloud.store.intake import Outcome, take_in
from cloud.store.item import Item
from cloud.store.salvage import take_in_apart
from eskin.messages import Result

log = logging.getLogger(__name__)

router = APIRouter(tags=["ingest"])

_NOTHING: Final = Outcome([], [], 0)
"""Of a batch whose token was used before."""


@router.post(
    "/ingest",
    response_model=IngestDocument,
    responses=documented(401, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_ingest(cloud: CloudState, request: Request) -> Response:
    """Store a batch: CBOR array of ``[node, plaintext]``. The answer comes after the commit."""
    async with received(cloud, request, within=True) as (warrant, body):
        with cloud.metrics.ingest_seconds.time():
            items = await apart(len(body), lambda: read_batch(body))
            outcome = await _store(cloud, warrant, items)
    if outcome is _NOTHING:
        raise used_before()
    for kind, count in Counter(receipt.result for receipt in outcome.results).items():
        cloud.metrics.items.labels(kind).inc(count)
    reasons = [result.reason for result in outcome.results if result.reason is not None]
    if reasons:
        log.warning(
            "messages rejected: gateway=%s count=%d last=%s",
            warrant.gateway,
            len(reasons),
            reasons[-1],
            extra={"source": warrant.gateway},
        )
    cloud.metrics.buried.inc(outcome.buried)
    results = [{"result": result.result, "reason": result.reason} for result in outcome.results]
    watched = cloud.onlookers.watched(dict.fromkeys(item.node for item in items))
    return as_json({"items": results, "watched": dict.fromkeys(watched, cloud.onlookers.lasting)})


async def _store(cloud: Cloud, warrant: Warrant, items: Sequence[Item]) -> Outcome:
    store, most = cloud.store, cloud.settings.store.dead_letters

    def work(take: Callable[..., Outcome], connection: Connection) -> Outcome:
        if not warrant.is_first(connection):
            return _NOTHING  # an error would undo the batches beside it
        now, gateway = cloud.clock(), warrant.gateway
        outcome = take(connection, store.cache, items, gateway=gateway, now=now, dead_letters=most)
        hear(connection, gateway, warrant.condition, now=now, outcome=outcome)
        return outcome

    written = store.write(
        partial(work, take_in), instead=partial(work, take_in_apart), together=True
    )
    cloud.feed.follow(written, asyncio.get_running_loop())
    outcome = await asyncio.wrap_future(written)
    if any(isinstance(item.message, Result) for item in items):
        cloud.board.wake()
    return outcome
