"""Deliveries: gateways ask for commands, and wait for an answer as long as there is none."""

import asyncio
import time
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Final

from fastapi import APIRouter, Request
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.runtime.http_server.problems import documented
from eskin.wire.timestamp import SECOND
from eskin_cloud.alarms.receivers import find_for_site, note_published
from eskin_cloud.api.dependencies import CloudState
from eskin_cloud.api.problems import CBOR_BODY
from eskin_cloud.api.request_body import MEDIA_TYPE, Received, received
from eskin_cloud.app_state import AppState
from eskin_cloud.commands.command_queue import (
    Changes,
    Holding,
    find_changes,
    find_unmarked,
    mark_delivered,
)
from eskin_cloud.store.write.gateways import record_contact
from eskin_cloud.store.write.write_cache import WriteCache

router = APIRouter(tags=["ingest"])

_LOOK_S: Final = 5.0
"""Commands also expire without a notification."""


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
    """Exchange commands and alarms: what to deliver, and what to drop."""
    async with received(cloud, request) as posted:
        holding = Holding.read(posted.body)
    await _mark(cloud, posted, holding)
    deadline = time.monotonic() + holding.wait_s
    while True:
        version = cloud.notifier.version
        changes = await asyncio.to_thread(_find, cloud, holding, posted.gateway.site)
        left = deadline - time.monotonic()
        if changes or left <= 0 or cloud.notifier.closed:
            return CborResponse(changes.encode())
        await cloud.notifier.wait(version, min(left, _LOOK_S))


def _find(cloud: AppState, holding: Holding, site: str) -> Changes:
    with cloud.store.read() as connection:
        found = find_changes(connection, holding, site=site, now=cloud.clock())
        return replace(found, alarms=find_for_site(connection, site, holding.published))


async def _mark(cloud: AppState, posted: Received, holding: Holding) -> None:
    def unmarked() -> list[tuple[str, int]]:
        with cloud.store.read() as connection:
            return find_unmarked(connection, holding, site=posted.gateway.site)

    sent = await asyncio.to_thread(unmarked) if holding.sent else []

    def mark(ours: list[tuple[str, int]], connection: Connection, cache: WriteCache) -> None:
        del cache
        mark_delivered(connection, ours, now=cloud.clock())

    for each in cloud.store.shares(sent, itemgetter(0)):
        written = cloud.store.write_slots(each.slots, partial(mark, each.items))
        await asyncio.wrap_future(written)

    def work(connection: Connection) -> None:
        now, wait = cloud.clock(), round(holding.wait_s * SECOND)
        if holding.published:
            note_published(connection, posted.gateway.site, holding.published)
        record_contact(
            connection,
            posted.gateway.name,
            site=posted.gateway.site,
            condition=posted.condition,
            now=now,
            wait=wait,
        )

    await asyncio.wrap_future(cloud.store.write(work))
