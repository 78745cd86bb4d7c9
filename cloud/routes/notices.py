"""Notices of subjects: gateways tell who wears what, give keys, and have them destroyed."""

import asyncio

from fastapi import APIRouter, Request
from starlette.responses import Response

from cloud.dependencies import CloudState
from cloud.ingest.reception import received
from cloud.privacy.erasures import find_erased, look
from cloud.privacy.notice import Notice, note
from cloud.problems import documented
from cloud.routes.answers import as_json
from cloud.routes.documents import CBOR_BODY, NoticeDocument
from cloud.state import Cloud

router = APIRouter(tags=["ingest"])


@router.post(
    "/subjects",
    response_model=NoticeDocument,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_subjects(cloud: CloudState, request: Request) -> Response:
    """Take a notice; what it says is done, and what is erased is destroyed, before the answer."""
    async with received(cloud, request) as posted:
        notice = await asyncio.to_thread(Notice.read, posted.body)
        items = await asyncio.to_thread(_keep, cloud, notice)
        written = cloud.store.write(
            lambda connection: note(
                connection, notice, gateway=posted.gateway.name, now=cloud.clock()
            )
        )
        await asyncio.wrap_future(written)
    return as_json({"items": items})


def _keep(cloud: Cloud, notice: Notice) -> list[dict[str, str]]:
    """Destroy keys first: what is erased in the same breath, or elsewhere, is not kept."""
    for subject in notice.erased:
        cloud.keyholder.erase(subject)
    if notice.worn:
        look(cloud)
    with cloud.store.read() as connection:
        buried = find_erased(connection, {worn.subject for worn in notice.worn})
    told = [
        (
            worn.subject,
            "erased" if worn.subject in buried else cloud.keyholder.keep(worn.subject, worn.key),
        )
        for worn in notice.worn
    ]
    told += [(subject, "erased") for subject in notice.erased]
    return [{"id": subject, "result": result} for subject, result in told]
