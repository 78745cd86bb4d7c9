"""Clouds on one store tell each other which nodes somebody looks at."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.jobs.pg_listener import listen
from eskin_cloud.jobs.viewers import announce_viewed_nodes
from eskin_cloud.settings import LiveSection
from eskin_cloud.store.schema.tables import NODE_LENGTH
from sqlalchemy import URL

from tests.unit.cloud.clouds import standing

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities

NODES = [f"n{number:0{NODE_LENGTH - 1}}" for number in range(1000)]


@pytest.mark.anyio
@pytest.mark.parametrize("place", ["postgresql"], indirect=True)
async def test_as_many_as_may_be_watched_are_told_however_long_their_names(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    live = LiveSection(watched_nodes=len(NODES), watched_s=6)
    assert isinstance(place, URL)
    stopping = asyncio.Event()
    with standing(tmp_path, identities, place=place, live=live) as stand:
        heard = stand.cloud.viewers
        tasks = [
            asyncio.create_task(listen(stand.cloud, place, stopping)),
            asyncio.create_task(announce_viewed_nodes(stand.cloud, stopping)),
        ]
        async with asyncio.timeout(60):
            with heard.looking(NODES):
                while len(heard._elsewhere) < len(NODES):  # noqa: ASYNC110 - somebody else's
                    await asyncio.sleep(0.05)
        stopping.set()
        tasks[0].cancel()
        await asyncio.wait(tasks)
