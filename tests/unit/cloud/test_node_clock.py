"""The API's verdict on a node's clock."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.query.clock_check import count_wrong_clocks

from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import status, stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def clock_of(stand: Stand, stated: tuple[int, int], heard: int | None, sequence: int) -> Any:
    """The verdict on a node's clock after a status with offsets from the cloud's time, in s."""
    now = stand.clock()
    time = now + stated[0] * SECOND, now + stated[1] * SECOND
    gateway_time = None if heard is None else now + heard * SECOND
    said = replace(status(sequence), time=time, gateway_time=gateway_time)
    assert (await stand.ingest(batch(said))).status_code == 200
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node == (await stand.get(f"/api/v1/nodes/{node['id']}")).json()
    return node["clock"]


async def test_node_s_clock_is_judged_by_its_latest_status(stand: Stand) -> None:
    seen = [
        await clock_of(stand, stated, heard, sequence)
        for sequence, (stated, heard) in enumerate([
            ((-9, 9), -1),
            ((-9, 9), None),
            ((3, 5), -1),
            ((-9, -5), -3),
            ((3, 5), 4),
        ])
    ]  # fmt: skip
    assert [each["verdict"] for each in seen] == [
        "certain", "possible", "impossible", "impossible", "possible",
    ]  # fmt: skip
    assert [each["references_agree"] for each in seen] == [True] * 4 + [False]
    assert seen[0]["offset"] == {"lo_ns": -SECOND, "hi_ns": 2 * SECOND}
    assert seen[1]["offset"] == {"lo_ns": -SECOND, "hi_ns": None}
    assert seen[2]["offset"]["lo_ns"] == 3 * SECOND
    assert seen[3]["offset"]["hi_ns"] == -3 * SECOND
    assert seen[4]["offset"] == {"lo_ns": None, "hi_ns": None}


async def test_wrong_clocks_are_counted(stand: Stand) -> None:
    for sequence, (stated, heard, wrong) in enumerate([
        ((-9, 9), -1, 0),
        ((3, 5), -1, 1),
        ((3, 5), None, 1),
        ((-9, 9), None, 0),
        ((-9, -5), -3, 1),
        ((3, 5), 4, 0),
    ]):  # fmt: skip
        await clock_of(stand, stated, heard, sequence)
        with stand.cloud.store.read() as connection:
            assert count_wrong_clocks(connection, SECOND) == wrong


async def test_node_without_a_status_states_nothing(stand: Stand) -> None:
    assert (await stand.ingest(batch(stretch(1)))).status_code == 200
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["clock"] is None
