"""Certificates: gateways present those of their nodes, so that the cloud knows their sites."""

import asyncio
from functools import partial
from operator import itemgetter

from fastapi import APIRouter, Request
from pydantic import BaseModel
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import received
from eskin_cloud.api.responses import as_json
from eskin_cloud.ingest.node_certificates import judge_chains, read_chains
from eskin_cloud.store.write.node_sites import store_sites
from eskin_cloud.store.write.write_cache import WriteCache

router = APIRouter(tags=["ingest"])


class CertificateItem(BaseModel):
    """What became of one chain: ``reason`` is null where the node is known from now on."""

    node: str
    reason: str | None


class CertificatesDocument(BaseModel):
    """What became of each chain, in the order in which they were presented."""

    items: list[CertificateItem]


@router.post(
    "/certificates",
    response_model=CertificatesDocument,
    responses=documented(401, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_certificates(cloud: CloudState, request: Request) -> Response:
    """Present nodes' certificate chains.

    The body is a CBOR array of ``[leaf, issuer]`` (DER). The answer comes after the commit.
    """
    async with received(cloud, request) as posted:
        gateway, site = posted.gateway.name, posted.gateway.site
        chains = await asyncio.to_thread(read_chains, posted.body)
        judged = await asyncio.to_thread(judge_chains, cloud.gateway_trust, chains, site)
        good = [(each.node, each.certificate) for each in judged if each.reason is None]

        def work(
            ours: list[tuple[str, bytes]], connection: Connection, cache: WriteCache
        ) -> dict[str, str]:
            del cache
            return store_sites(connection, ours, site=site, gateway=gateway, now=cloud.clock())

        sites: dict[str, str] = {}
        for each in cloud.store.shares(good, itemgetter(0)):
            written = cloud.store.write_slots(each.slots, partial(work, each.items))
            stored = await asyncio.wrap_future(written)
            sites |= stored
    items = []
    for node, _, refused in judged:
        other = refused is None and sites[node] != site
        reason = f"{node} is known as a node of another site" if other else refused
        items.append({"node": node, "reason": reason})
    return as_json({"items": items})
