"""Ingest: gateways send nodes' messages."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.privacy import SealedMessage
from eskin.runtime.http_server.problems import documented
from eskin.wire.messages import Result
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import Received, apart, received
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState
from eskin_cloud.ingest.batch import read_batch
from eskin_cloud.schemas.base import Json
from eskin_cloud.schemas.ingest import IngestDocument
from eskin_cloud.store.write.gateways import record_contact
from eskin_cloud.store.write.ingest import (
    IngestResult,
    Receipt,
    ingest,
    ingest_individually,
)
from eskin_cloud.store.write.parsed_message import ParsedMessage

log = logging.getLogger(__name__)

router = APIRouter(tags=["ingest"])


@router.post(
    "/ingest",
    response_model=IngestDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_ingest(cloud: CloudState, request: Request) -> Response:
    """Store a batch of nodes' messages.

    The body is a CBOR array of ``[node, plaintext]``. The answer comes after the commit.
    """
    async with received(cloud, request) as posted:
        body = posted.body
        begun = time.perf_counter()
        items = await apart(len(body), lambda: read_batch(body))
        outcome = await _store(cloud, posted, items)
    # A reader of the metrics must not be able to count what is sealed.
    kinds = Counter(
        receipt.result
        for item, receipt in zip(items, outcome.results, strict=True)
        if not isinstance(item.message, SealedMessage)
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
    cloud.metrics.dead_letters_dropped.inc(outcome.dropped)
    cloud.metrics.conflicts.inc(outcome.conflicts)
    results = [_describe(result) for result in outcome.results]
    return as_json({"items": results})


def _describe(receipt: Receipt) -> Json:
    document: Json = {"result": receipt.result, "reason": receipt.reason}
    if receipt.want:
        document["want"] = [name.hex() for name in receipt.want]
    return document


async def _store(cloud: AppState, posted: Received, items: Sequence[ParsedMessage]) -> IngestResult:
    store, most = cloud.store, cloud.settings.store.dead_letters

    def work(take: Callable[..., IngestResult], connection: Connection) -> IngestResult:
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
        record_contact(
            connection, gateway, site=site, condition=posted.condition, now=now, outcome=outcome
        )
        return outcome

    written = store.write(
        partial(work, ingest), fallback=partial(work, ingest_individually), shared=True
    )
    cloud.feed.follow(written, asyncio.get_running_loop())
    outcome = await asyncio.wrap_future(written)
    if any(isinstance(item.message, Result) for item in items):
        cloud.notifier.wake()
    return outcome
