"""Ingest: gateways send nodes' messages."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.errors import StoreError
from eskin.privacy import SealedMessage
from eskin.runtime.http_server.problems import documented
from eskin.wire.messages import Result
from eskin.wire.slot import SlotShare, in_order
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import Received, apart, received
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState
from eskin_cloud.ingest.batch import read_batch
from eskin_cloud.schemas.base import Json
from eskin_cloud.schemas.ingest import IngestDocument
from eskin_cloud.store.write.ingest import (
    LATER,
    REJECTED,
    UNKNOWN_LAYOUT,
    UNKNOWN_NODE,
    IngestResult,
    Receipt,
    ingest,
    ingest_individually,
)
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.write_cache import WriteCache

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
        receipts = await _store(cloud, posted, items)
    # A reader of the metrics must not be able to count what is sealed.
    kinds = Counter(
        receipt.result
        for item, receipt in zip(items, receipts, strict=True)
        if not isinstance(item.message, SealedMessage)
    )
    for kind, count in kinds.items():
        cloud.metrics.items.labels(kind).inc(count)
    if kinds:
        cloud.metrics.ingest_seconds.observe(time.perf_counter() - begun)
    _log_refusals(posted.gateway.name, receipts)
    return as_json({"items": [_describe(receipt) for receipt in receipts]})


def _log_refusals(gateway: str, receipts: Sequence[Receipt]) -> None:
    """Log why messages were not stored.

    That a message comes before the certificate or the descriptions by which it is read is usual:
    the gateway posts them next.
    """
    source = {"source": gateway}
    early = [each.reason for each in receipts if each.result in {UNKNOWN_NODE, UNKNOWN_LAYOUT}]
    if early:
        text = "messages came early: gateway=%s count=%d last=%s"
        log.info(text, gateway, len(early), early[-1], extra=source)
    rejected = [each.reason for each in receipts if each.result in {REJECTED, LATER}]
    if rejected:
        text = "messages rejected: gateway=%s count=%d last=%s"
        log.warning(text, gateway, len(rejected), rejected[-1], extra=source)


def _describe(receipt: Receipt) -> Json:
    document: Json = {"result": receipt.result, "reason": receipt.reason}
    if receipt.want:
        document["want"] = [name.hex() for name in receipt.want]
    return document


async def _store(
    cloud: AppState, posted: Received, items: Sequence[ParsedMessage]
) -> list[Receipt]:
    """Store a batch: the messages of each group of slots in a transaction of their own.

    Where the store fails for some groups only, their messages are answered ``later``.

    Raises:
        StoreError: Nothing is stored.
    """
    store, most = cloud.store, cloud.settings.store.dead_letters
    gateway, site = posted.gateway.name, posted.gateway.site

    def work(
        take: Callable[..., IngestResult],
        ours: Sequence[ParsedMessage],
        connection: Connection,
        cache: WriteCache,
    ) -> IngestResult:
        return take(
            connection,
            cache,
            ours,
            gateway=gateway,
            site=site,
            now=cloud.clock(),
            dead_letters=most,
        )

    async def write(share: SlotShare[ParsedMessage]) -> IngestResult:
        written = store.write_slots(
            share.slots,
            partial(work, ingest, share.items),
            fallback=partial(work, ingest_individually, share.items),
            shared=True,
        )
        cloud.feed.follow(written, asyncio.get_running_loop())
        return await asyncio.wrap_future(written)

    shares = store.shares(items, attrgetter("node"))
    done = await asyncio.gather(*map(write, shares), return_exceptions=True)
    outcomes = [each for each in done if isinstance(each, IngestResult)]
    for outcome in outcomes or ([] if shares else [IngestResult([], [], 0)]):
        cloud.gateway_contacts.note(gateway, site=site, condition=posted.condition, outcome=outcome)
        cloud.metrics.dead_letters_dropped.inc(outcome.dropped)
        cloud.metrics.conflicts.inc(outcome.conflicts)
    results: list[Sequence[Receipt]] = []
    for share, each in zip(shares, done, strict=True):
        if isinstance(each, IngestResult):
            results.append(each.results)
        elif isinstance(each, StoreError) and outcomes:
            results.append([Receipt(LATER, str(each))] * len(share.items))
        else:
            raise each
    if any(isinstance(item.message, Result) for item in items):
        cloud.notifier.wake()
    return in_order(shares, results)
