"""Refused messages and gateways are logged, and fill no log."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.settings import LimitsSection

from tests.support.logs import log_lines
from tests.unit.cloud.clouds import batch, standing
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_node_whose_every_message_is_refused_fills_no_log(stand: Stand) -> None:
    await stand.ingest(batch(stretch(0)))
    with log_lines() as lines:
        for number in range(1, 1000, 20):
            bad = [stretch(number + k, unit="V") for k in range(20)]
            answer = await stand.ingest(batch(*bad))
            assert {item["result"] for item in answer.json()["items"]} == {"rejected"}
    stated = [line for line in lines() if "gateway=" in line]
    assert 1 <= len(stated) <= 10
    assert all("a channel keeps its unit" in line for line in stated)


@pytest.mark.usefixtures("standing_windows")
async def test_flood_without_credentials_is_logged_within_its_limit_only(
    tmp_path: Path, identities: Identities, caplog: pytest.LogCaptureFixture
) -> None:
    few = LimitsSection(failures_per_min=3)
    with (
        standing(tmp_path, identities, limits=few) as stand,
        caplog.at_level(logging.INFO),
    ):
        stand.gateway = None
        async with stand.ingest_client() as client:
            headers = {"content-type": "application/cbor"}
            statuses = {
                (await client.post("/api/v1/ingest", content=b"", headers=headers)).status_code
                for _ in range(50)
            }
    assert 429 in statuses
    assert sum(record.name.startswith("cloud") for record in caplog.records) <= 3
