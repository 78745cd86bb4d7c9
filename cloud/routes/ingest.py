"""Ingest: gateways bring what nodes said."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from cloud.dependencies import CloudState
from cloud.ingest.batch import read_batch
from cloud.ingest.reception import Received, apart, received
from cloud.routes.answers import as_json
from cloud.routes.documents import CBOR_BODY, IngestDocument
from cloud.state import Cloud
from cloud.store.gateways import hear
from cloud.store.intake import UNKNOWN_NODE, Outcome, take_in
from cloud.store.item import Item
from cloud.store.salvage import take_in_apart
from eskin.messages import Result
from eskin.privacy import Veiled
from eskin.problems import documented

log = logging.getLogger(__name__)

router = APIRouter(tags=["ingest"])


@router.post(
    "/ingest",
    response_model=IngestDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_ingest(cloud: CloudState, request: Request) -> Response:
    """Store a batch: CBOR array of ``[node, plaintext]``. The answer comes after the commit."""
    async with received(cloud, request) as posted:
        body = posted.body
        begun = time.perf_counter()
        items = await apart(len(body), lambda: read_batch(body))
        outcome = await _store(cloud, posted, items)
    # A reader of the metrics must not be able to count what is sealed.
    kinds = Counter(
        receipt.result
        for item, receipt in zip(items, outcome.results, strict=True)
        if not isinstance(item.message, Veiled)
    )
    for kind, count in kinds.items():
        cloud.metrics.items.labels(kind).inc(count)
    if kinds:
        cloud.metrics.ingest_seconds.observe(time.perf_counter() - begun)
    reasons = [result.reason for result in outcome.results if result.reason is not None]
    if reasons:
        log.warning(
            "messages rejected: gateway=%s count=%d last=%s",
            posted.gateway.name,
            len(reasons),
            reasons[-1],
            extra={"source": posted.gateway.name},
        )
    cloud.metrics.buried.inc(outcome.buried)
    cloud.metrics.conflicts.inc(outcome.conflicts)
    results = [{"result": result.result, "reason": result.reason} for result in outcome.results]
    own = (
        item.node
        for item, receipt in zip(items, outcome.results, strict=True)
        if receipt.result != UNKNOWN_NODE
    )
    watched = cloud.onlookers.watched(dict.fromkeys(own))
    return as_json({"items": results, "watched": dict.fromkeys(watched, cloud.onlookers.lasting)})


async def _store(cloud: Cloud, posted: Received, items: Sequence[Item]) -> Outcome:
    store, most = cloud.store, cloud.settings.store.dead_letters

    def work(take: Callable[..., Outcome], connection: Connection) -> Outcome:
        now, gateway, site = cloud.clock(), posted.gateway.name, posted.gateway.site
        outcome = take(
            connection,
            store.cache,
            items,
            gateway=gateway,
            site=site,
            now=now,
            dead_letters=most,
        )
        hear(connection, gateway, site=site, condition=posted.condition, now=now, outcome=outcome)
        return outcome

    written = store.write(
        partial(work, take_in), instead=partial(work, take_in_apart), together=True
    )
    cloud.feed.follow(written, asyncio.get_running_loop())
    outcome = await asyncio.wrap_future(written)
    if any(isinstance(item.message, Result) for item in items):
        cloud.board.wake()
    return outcome
