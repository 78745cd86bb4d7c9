"""Confirmed messages: whether the store still has them, after it was restored."""

import asyncio
import logging
from collections import defaultdict
from functools import partial

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import received
from eskin_cloud.api.responses import as_json
from eskin_cloud.ingest.confirmed import read_confirmed
from eskin_cloud.schemas.ingest import ConfirmedDocument
from eskin_cloud.store.write.missing_messages import find_missing_tails, record_boot_ends
from eskin_cloud.store.write.node_sites import sites_of
from eskin_cloud.store.write.presence import add_offline_node
from eskin_cloud.store.write.write_cache import WriteCache

log = logging.getLogger(__name__)

router = APIRouter(tags=["ingest"])


@router.post(
    "/confirmed",
    response_model=ConfirmedDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_confirmed(cloud: CloudState, request: Request) -> Response:
    """Compare confirmed messages with the store; answers what it lacks.

    The body is a CBOR array of ``[node, boot, last]``. For nodes that are unknown here, the
    answer holds their names: present their certificates, and repeat the request.
    """
    async with received(cloud, request) as posted:
        confirmed = await asyncio.to_thread(read_confirmed, posted.body)

        def find() -> tuple[list[tuple[str, int, int, int]], set[str]]:
            with cloud.store.read() as connection:
                named = {each[0] for each in confirmed}
                sites = sites_of(connection, named)
                own = {node for node in named if sites.get(node) == posted.gateway.site}
                tails = find_missing_tails(
                    connection, [each for each in confirmed if each[0] in own]
                )
                return tails, named - own

        missing, unknown = await asyncio.to_thread(find)

        ends = defaultdict(list)
        for node, boot, _, last in missing:
            ends[node].append((boot, last))

        def keep(nodes: list[str], connection: Connection, cache: WriteCache) -> None:
            for node in nodes:
                add_offline_node(connection, cache, node, max(ends[node]), now=cloud.clock())
                record_boot_ends(connection, node, ends[node])

        if missing:
            log.error(
                "confirmed messages missing: gateway=%s ranges=%d messages=%d",
                posted.gateway.name,
                len(missing),
                sum(last - first + 1 for _, _, first, last in missing),
                extra={"source": posted.gateway.name},
            )
            for each in cloud.store.shares(ends, str):
                written = cloud.store.write_slots(each.slots, partial(keep, each.items))
                await asyncio.wrap_future(written)
    names = ("node", "boot", "first", "last")
    items = [dict(zip(names, each, strict=True)) for each in missing]
    return as_json({"items": items, "unknown_nodes": sorted(unknown)})
