"""Descriptions: gateways present their nodes' patches and layouts, by which frames are read."""

import asyncio
from functools import partial
from operator import attrgetter

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin.wire.slot import in_order
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import apart, received
from eskin_cloud.api.responses import as_json
from eskin_cloud.ingest.posted_descriptions import Posted, PostedResult, read_posted, store_posted
from eskin_cloud.schemas.ingest import DescriptionsDocument
from eskin_cloud.store.write.write_cache import WriteCache

router = APIRouter(tags=["ingest"])


@router.post(
    "/descriptions",
    response_model=DescriptionsDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_descriptions(cloud: CloudState, request: Request) -> Response:
    """Present nodes' patches and layouts, at most 500.

    The body is a CBOR array of ``[node, plaintext]``. The answer comes after the commit.
    """
    async with received(cloud, request) as posted:
        body, site = posted.body, posted.gateway.site
        presented = await apart(len(body), lambda: read_posted(body))

        def work(
            ours: list[Posted], connection: Connection, cache: WriteCache
        ) -> list[PostedResult]:
            return store_posted(connection, cache, ours, site=site)

        shares = cloud.store.shares(presented, attrgetter("node"))
        stored = [
            await asyncio.wrap_future(
                cloud.store.write_slots(each.slots, partial(work, each.items))
            )
            for each in shares
        ]
        results = in_order(shares, stored)
    return as_json({"items": [result._asdict() for result in results]})
