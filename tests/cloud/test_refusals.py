"""Refused messages are told of, and fill no log."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import pytest

from cloud.ingest.refusals import Refusals
from tests.cloud.clouds import batch
from tests.cloud.messages import block

if TYPE_CHECKING:
    from tests.cloud.clouds import Stand


def test_each_gateway_is_told_of_once_a_second_with_all_that_came(
    caplog: pytest.LogCaptureFixture,
) -> None:
    now = [0.0]
    refusals = Refusals(lambda: now[0])
    with caplog.at_level(logging.WARNING):
        for _ in range(100):
            refusals.tell("gateway.a", ["other unit", "no message"])
            refusals.tell("gateway.b", [])
            now[0] += 0.015
        refusals.tell("gateway.b", ["bad"])
    assert [record.getMessage() for record in caplog.records] == [
        "messages rejected: gateway=gateway.a count=2 last=no message",
        "messages rejected: gateway=gateway.a count=134 last=no message",
        "messages rejected: gateway=gateway.b count=1 last=bad",
    ]


@pytest.mark.anyio
async def test_node_whose_every_message_is_refused_fills_no_log(
    stand: Stand, caplog: pytest.LogCaptureFixture
) -> None:
    await stand.ingest(batch(block(0)))
    stand.cloud.refusals._clock = lambda: 0.0  # all of it within a second, on any machine
    with caplog.at_level(logging.WARNING):
        for number in range(1, 200, 20):
            bad = [block(number + k, unit="V") for k in range(20)]
            answer = await stand.ingest(batch(*bad))
            assert {item["result"] for item in answer.json()["items"]} == {"rejected"}
    (told,) = (record for record in caplog.records if "rejected" in record.getMessage())
    assert "a channel keeps its unit" in told.getMessage()
