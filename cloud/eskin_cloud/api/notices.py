"""Notices of subjects: gateways send assignments, keys and erasures."""

import asyncio
from functools import partial
from operator import attrgetter

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import received
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState
from eskin_cloud.privacy.subject_notice import SubjectNotice, Worn, note, store_assignments
from eskin_cloud.schemas.ingest import NoticeDocument
from eskin_cloud.store.schema.sealed_tables import find_erased
from eskin_cloud.store.write.ingest import UNKNOWN_NODE
from eskin_cloud.store.write.node_sites import sites_of
from eskin_cloud.store.write.write_cache import WriteCache

router = APIRouter(tags=["ingest"])


@router.post(
    "/subjects",
    response_model=NoticeDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_subjects(cloud: CloudState, request: Request) -> Response:
    """Take a notice of subjects: assignments, keys and erasures.

    Erased keys are destroyed before the answer. A notice concerns the gateway's own site only: a
    subject of another site, with the same name, is not touched.
    """
    async with received(cloud, request) as posted:
        gateway, site = posted.gateway.name, posted.gateway.site
        notice = await asyncio.to_thread(SubjectNotice.read, posted.body)
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

        def assign(worn: list[Worn], connection: Connection, cache: WriteCache) -> None:
            del cache
            store_assignments(connection, worn, now=cloud.clock())

        for each in cloud.store.shares(own.worn, attrgetter("node")):
            written = cloud.store.write_slots(each.slots, partial(assign, each.items))
            await asyncio.wrap_future(written)
    cloud.metrics.conflicts.inc(len(conflicts))
    return as_json({"items": items})


def _keep(
    cloud: AppState, notice: SubjectNotice, site: str
) -> tuple[list[dict[str, str]], SubjectNotice]:
    """Destroy keys first: what is erased in the same notice, or elsewhere, is not kept.

    Returns:
        What became of each entry, and the entries of the site's own nodes.
    """
    for subject in notice.erased:
        cloud.key_access.erase(site, subject)
    with cloud.store.read() as connection:
        if notice.worn:
            cloud.key_access.apply_erasures(connection)
        sites = sites_of(connection, {worn.node for worn in notice.worn})
        erased = find_erased(connection, site, {worn.subject for worn in notice.worn})
    own = [worn for worn in notice.worn if sites.get(worn.node) == site]
    answered = []
    for worn in notice.worn:
        if worn not in own:
            result = UNKNOWN_NODE
        elif worn.subject in erased:
            result = "erased"
        else:
            result = cloud.key_access.keep(site, worn.subject, worn.key)
        answered.append({"id": worn.subject, "result": result})
    answered += [{"id": subject, "result": "erased"} for subject in notice.erased]
    return answered, SubjectNotice(own, notice.erased)
