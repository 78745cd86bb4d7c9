"""Notices of subjects: gateways tell who wears what, give keys, and have them destroyed."""

import asyncio

from fastapi import APIRouter, Request
from starlette.responses import Response

from cloud.dependencies import CloudState
from cloud.ingest.reception import received
from cloud.privacy.erasures import find_erased, look
from cloud.privacy.notice import Notice, note
from cloud.routes.answers import as_json
from cloud.routes.documents import CBOR_BODY, NoticeDocument
from cloud.state import Cloud
from cloud.store.intake import UNKNOWN_NODE
from cloud.store.node_sites import sites_of
from eskin.problems import documented

router = APIRouter(tags=["ingest"])


@router.post(
    "/subjects",
    response_model=NoticeDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_subjects(cloud: CloudState, request: Request) -> Response:
    """Take a notice; what it says is done, and what is erased is destroyed, before the answer.

    All of it is of the gateway's own site: a subject of another one, by the same name, is not
    touched.
    """
    async with received(cloud, request) as posted:
        gateway, site = posted.gateway.name, posted.gateway.site
        notice = await asyncio.to_thread(Notice.read, posted.body)
        items, own = await asyncio.to_thread(_keep, cloud, notice, site)
        conflicts = [item["id"] for item in items if item["result"] == "conflict"]
        written = cloud.store.write(
            lambda connection: note(
                connection,
                own,
                site=site,
                gateway=gateway,
                now=cloud.clock(),
                conflicts=conflicts,
            )
        )
        await asyncio.wrap_future(written)
    cloud.metrics.conflicts.inc(len(conflicts))
    return as_json({"items": items})


def _keep(cloud: Cloud, notice: Notice, site: str) -> tuple[list[dict[str, str]], Notice]:
    """Destroy keys first: what is erased in the same breath, or elsewhere, is not kept.

    Returns:
        What became of each entry, and what is the site's to say.
    """
    for subject in notice.erased:
        cloud.keyholder.erase(site, subject)
    if notice.worn:
        look(cloud)
    with cloud.store.read() as connection:
        sites = sites_of(connection, {worn.node for worn in notice.worn})
        buried = find_erased(connection, site, {worn.subject for worn in notice.worn})
    own = [worn for worn in notice.worn if sites.get(worn.node) == site]
    told = []
    for worn in notice.worn:
        if worn not in own:
            result = UNKNOWN_NODE
        elif worn.subject in buried:
            result = "erased"
        else:
            result = cloud.keyholder.keep(site, worn.subject, worn.key)
        told.append({"id": worn.subject, "result": result})
    told += [{"id": subject, "result": "erased"} for subject in notice.erased]
    return told, Notice(own, notice.erased)
