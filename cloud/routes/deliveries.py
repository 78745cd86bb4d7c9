"""Deliveries: gateways ask for commands, and wait for an answer as long as there is none."""

import asyncio
import time
from typing import Final

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from cloud.commands.deliveries import (
    Changes,
    Holding,
    find_changes,
    find_unmarked,
    mark_delivered,
)
from cloud.dependencies import CloudState
from cloud.ingest.reception import MEDIA_TYPE, Received, received
from cloud.routes.documents import CBOR_BODY
from cloud.state import Cloud
from cloud.store.gateways import hear
from eskin.moment import SECOND
from eskin.problems import documented

router = APIRouter(tags=["ingest"])

_LOOK_S: Final = 5.0
"""Time passes, too: commands expire without anybody's word."""


class CborResponse(Response):
    """An answer in CBOR."""

    media_type = MEDIA_TYPE


@router.post(
    "/deliveries",
    response_class=CborResponse,
    responses=documented(403, 413, 415, 422, 503),
    openapi_extra=CBOR_BODY,
)
async def post_deliveries(cloud: CloudState, request: Request) -> Response:
    """Commands that a gateway does not hold yet, and those that it should deliver no more."""
    async with received(cloud, request) as posted:
        holding = Holding.read(posted.body)
    await _mark(cloud, posted, holding)
    deadline = time.monotonic() + holding.wait_s
    while True:
        version = cloud.board.version
        changes = await asyncio.to_thread(_find, cloud, holding, posted.gateway.site)
        left = deadline - time.monotonic()
        if changes.give or changes.drop or left <= 0 or cloud.board.closed:
            return CborResponse(changes.encode())
        await cloud.board.wait(version, min(left, _LOOK_S))


def _find(cloud: Cloud, holding: Holding, site: str) -> Changes:
    with cloud.store.read() as connection:
        return find_changes(connection, holding, site=site, now=cloud.clock())


async def _mark(cloud: Cloud, posted: Received, holding: Holding) -> None:
    def unmarked() -> list[tuple[str, int]]:
        with cloud.store.read() as connection:
            return find_unmarked(connection, holding, site=posted.gateway.site)

    sent = await asyncio.to_thread(unmarked) if holding.sent else []

    def work(connection: Connection) -> None:
        now, wait = cloud.clock(), round(holding.wait_s * SECOND)
        mark_delivered(connection, sent, now=now)
        hear(
            connection,
            posted.gateway.name,
            site=posted.gateway.site,
            condition=posted.condition,
            now=now,
            wait=wait,
        )

    await asyncio.wrap_future(cloud.store.write(work))
