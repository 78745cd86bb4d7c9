"""Ingest: gateways bring what nodes said."""

import asyncio
import hashlib
import logging
from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Header, Request
from sqlalchemy import Connection
from starlette.responses import Response

from cloud.dependencies import CloudState
from cloud.ingest.batch import read_batch
from cloud.ingest.errors import BatchTooLargeError, BatchTypeError
from cloud.ingest.warrant import Warrant
from cloud.problems import documented
from cloud.routes.answers import as_json
from cloud.routes.documents import IngestDocument
from cloud.state import Cloud
from cloud.store.intake import Item, Outcome, take_in

router = APIRouter(tags=["ingest"])

log = logging.getLogger(__name__)

_MEDIA_TYPE = "application/cbor"


@router.post(
    "/ingest",
    response_model=IngestDocument,
    responses=documented(401, 413, 415, 422, 503),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {_MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}},
        },
        "security": [{"gateway": []}],
    },
)
async def post_ingest(
    cloud: CloudState,
    request: Request,
    content_type: Annotated[str | None, Header(include_in_schema=False)] = None,
    authorization: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> Response:
    """Store a batch: CBOR array of ``[node, plaintext]``. The answer comes after the commit."""
    if (content_type or "").partition(";")[0].strip().lower() != _MEDIA_TYPE:
        raise BatchTypeError(f"Content-Type is {content_type!r}; send {_MEDIA_TYPE}")
    # Who it is comes first: a stranger shall not fill our memory.
    warrant = await asyncio.to_thread(cloud.verifier.verify, authorization)
    body = await _read(request, cloud.settings.gateways.body_bytes)
    with cloud.metrics.ingest_seconds.time():
        outcome = await _store(cloud, warrant, body)
    for result in outcome.results:
        cloud.metrics.items.labels(result.result).inc()
        if result.reason is not None:
            log.warning("message rejected: gateway=%s reason=%s", warrant.gateway, result.reason)
    cloud.metrics.buried.inc(outcome.buried)
    items = [{"result": result.result, "reason": result.reason} for result in outcome.results]
    return as_json({"items": items})


async def _read(request: Request, most: int) -> bytes:
    announced = request.headers.get("content-length", "")
    body = bytearray()
    if not announced.isdecimal() or int(announced) <= most:
        async for part in request.stream():
            body += part
            if len(body) > most:
                break
        else:
            return bytes(body)
    raise BatchTooLargeError(f"the body is longer than {most} bytes; send smaller batches")


async def _store(cloud: Cloud, warrant: Warrant, body: bytes) -> Outcome:
    def prepare() -> Sequence[Item]:
        warrant.require_body(hashlib.sha256(body).hexdigest())
        return read_batch(body)

    items = await asyncio.to_thread(prepare)
    store, most = cloud.store, cloud.settings.store.dead_letters

    def work(connection: Connection) -> Outcome:
        return take_in(
            connection,
            store.ledger,
            items,
            gateway=warrant.gateway,
            now=cloud.clock(),
            dead_letters=most,
        )

    written = store.write(work)
    cloud.feed.follow(written, asyncio.get_running_loop())
    return await asyncio.wrap_future(written)
