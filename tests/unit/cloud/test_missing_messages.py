"""Missing messages: reported after a while, withdrawn when they arrive."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import cbor2
import pytest
from eskin_cloud.jobs.missing_messages import look
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.write.missing_messages import count_missing, subtract
from eskin_cloud.store.write.pages import add_frames
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire.messages import Position
from eskin.wire.sequence_set import SequenceRanges
from tests.unit.cloud.clouds import admit, batch, standing
from tests.unit.cloud.messages import NODE, gap, status, stretch

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Said, Stand

pytestmark = pytest.mark.anyio

PATIENCE_S: Final = 300.0


async def bring(stand: Stand, *messages: Said) -> None:
    """Store messages of a node."""
    assert (await stand.ingest(batch(*messages))).status_code == 200


async def wait(stand: Stand) -> Any:
    """Search before and after the patience; returns what is then missing."""
    await look(stand.cloud)
    stand.clock.turn(PATIENCE_S)
    await look(stand.cloud)
    return await missing(stand)


async def missing(stand: Stand) -> Any:
    """What the node's document states as missing, equal to the list's and the metric."""
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node == (await stand.get(f"/api/v1/nodes/{NODE}")).json()
    stated = node["missing"]
    with stand.cloud.store.read() as connection:
        assert count_missing(connection) == (0 if stated is None else stated["messages"])
    return stated


async def details(stand: Stand) -> list[str]:
    """The details of events, the oldest first."""
    found = (await stand.get("/api/v1/events", kind="status", order="asc")).json()["items"]
    return [event["detail"] for event in found if not event["detail"].startswith("started")]


def ranges(stated: Any) -> list[tuple[int, int, int]]:
    """Boot, first and last of each range."""
    return [(each["boot"], each["first"], each["last"]) for each in stated["ranges"]]


async def test_gap_between_stored_messages_is_reported_after_five_minutes(stand: Stand) -> None:
    await bring(stand, *(stretch(number) for number in (0, 1, 2, 7, 8, 10)))
    await look(stand.cloud)
    stand.clock.turn(PATIENCE_S - 1)
    await look(stand.cloud)
    assert await missing(stand) is None
    stand.clock.turn(1)
    await look(stand.cloud)
    stated = await missing(stand)
    assert stated["messages"] == 5
    assert ranges(stated) == [(1, 3, 6), (1, 9, 9)]
    (said,) = await details(stand)
    assert "missing" in said
    assert "3 to 6" in said
    await look(stand.cloud)
    assert len(await details(stand)) == 1  # once


async def test_late_message_withdraws_the_report(stand: Stand) -> None:
    await bring(stand, *(stretch(number) for number in (0, 5)))
    assert (await wait(stand))["messages"] == 4
    await bring(stand, stretch(1), stretch(2))
    await look(stand.cloud)
    assert ranges(await missing(stand)) == [(1, 3, 4)]
    assert len(await details(stand)) == 1
    await bring(stand, stretch(3), stretch(4))
    await look(stand.cloud)
    assert await missing(stand) is None
    assert [each.split(":")[0] for each in await details(stand)] == ["missing", "found"]


async def test_gap_that_fills_in_time_is_not_reported(stand: Stand) -> None:
    await bring(stand, *(stretch(number) for number in (0, 5)))
    await look(stand.cloud)
    await bring(stand, *(stretch(number) for number in (1, 2, 3, 4)))
    assert await wait(stand) is None
    assert await details(stand) == []


async def test_lost_messages_of_a_gap_are_not_missing(stand: Stand) -> None:
    await bring(stand, stretch(3), gap(4), stretch(7))
    assert ranges(await wait(stand)) == [(1, 5, 6)]
    await bring(stand, gap(8, lost=((1, 5, 6),)))
    await look(stand.cloud)
    assert await missing(stand) is None


async def test_dead_letter_is_not_missing(stand: Stand) -> None:
    refused = [stretch(number, unit="H") for number in (1, 2, 4)]
    await bring(stand, stretch(0), refused[0], refused[1], stretch(3), refused[2])
    await bring(stand, replace(status(0, boot=5), ended=((1, 4),)))
    assert await wait(stand) is None


async def test_dead_letters_hide_no_missing_message(stand: Stand) -> None:
    said = [stretch(number, unit="FH"[number % 2]) for number in range(2100)]
    await bring(stand, *said, stretch(2101))
    assert ranges(await wait(stand)) == [(1, 2100, 2100)]


async def test_message_that_fails_is_not_missing(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def add(*args: Any) -> None:
        if any(row.sequence == 1 for row in args[-1]):
            raise ZeroDivisionError
        add_frames(*args)

    monkeypatch.setattr("eskin_cloud.store.write.ingest.add_frames", add)
    await bring(stand, *(stretch(number) for number in range(3)))
    assert await wait(stand) is None


async def test_end_of_a_former_boot_shows_its_missing_tail(stand: Stand) -> None:
    await bring(stand, stretch(0), stretch(1), replace(status(0, boot=5), ended=((1, 9), (3, 2))))
    assert ranges(await wait(stand)) == [(1, 2, 9), (3, 0, 2)]


async def test_messages_in_flash_are_not_missing(stand: Stand) -> None:
    holding = replace(status(20), held=Position(1, 10))
    await bring(stand, stretch(0), holding)
    assert ranges(await wait(stand)) == [(1, 1, 9)]
    await bring(stand, replace(status(21), held=Position(1, 22)))
    assert ranges(await wait(stand)) == [(1, 1, 19)]


async def test_removed_messages_are_not_missing(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    rules = RetentionSection(days=1.0)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        await bring(stand, *(stretch(number) for number in range(6)))
        stand.clock.turn(3 * 86_400)
        assert await sweep(stand.cloud) == 6
        for _ in range(2):
            stand.clock.turn(PATIENCE_S)
            await look(stand.cloud)
        with stand.cloud.store.read() as connection:
            assert count_missing(connection) == 0


@pytest.mark.parametrize(
    ("ended", "lost"),
    [
        (((1, 2),), False),
        (((1, 9),), False),
        (((1, 1),), True),
        ((), True),
        (None, False),
    ],
)
async def test_flash_rollback_is_reported(
    stand: Stand,
    ended: tuple[tuple[int, int], ...] | None,
    lost: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    await bring(stand, stretch(0), stretch(1), stretch(2), status(3, boot=0))
    await bring(stand, replace(status(0, boot=2), ended=ended))
    assert any("flash" in each for each in await details(stand)) is lost


async def test_store_rollback_is_reported_by_node_and_range(stand: Stand) -> None:
    await bring(stand, *(stretch(number) for number in range(4)))
    admit(stand.cloud.store, "palm")
    async with stand.ingest_client() as gateway:

        async def ask(*confirmed: tuple[str, int, int]) -> list[tuple[str, int, int, int]]:
            body = cbor2.dumps([list(each) for each in confirmed])
            headers = {"Content-Type": "application/cbor"}
            answer = await gateway.post("/api/v1/confirmed", content=body, headers=headers)
            assert answer.status_code == 200
            return [tuple(item.values()) for item in answer.json()["items"]]

        assert await ask((NODE, 1, 3), (NODE, 1, 2)) == []
        await bring(stand, stretch(4, unit="H"))
        assert await ask((NODE, 1, 4)) == []
        assert await ask((NODE, 1, 9), ("palm", 4, 0)) == [(NODE, 1, 5, 9), ("palm", 4, 0, 0)]
        body = cbor2.dumps([[NODE, 1, 3], ["thumb", 2, 7]])
        answer = await gateway.post("/api/v1/confirmed", content=body)
        assert answer.json() == {"items": [], "unknown_nodes": ["thumb"]}
    await look(stand.cloud)
    stand.clock.turn(PATIENCE_S)
    await look(stand.cloud)
    found = (await stand.get("/api/v1/nodes")).json()["items"]
    assert {node["id"]: ranges(node["missing"]) for node in found} == {
        NODE: [(1, 5, 9)],
        "palm": [(4, 0, 0)],
    }


async def test_missing_ranges_of_a_node_are_bounded(stand: Stand) -> None:
    await bring(stand, *(stretch(2 * number + 1) for number in range(1100)))
    assert (await wait(stand))["messages"] == 1000


spans = st.lists(st.tuples(st.integers(0, 40), st.integers(0, 6)), max_size=6)


@given(spans, spans)
def test_subtraction_equals_that_of_sets(
    one: list[tuple[int, int]], other: list[tuple[int, int]]
) -> None:
    mine = list(SequenceRanges((a, a + n) for a, n in one))
    theirs = sorted((a, a + n) for a, n in other)
    left = {k for first, last in subtract(mine, theirs) for k in range(first, last + 1)}
    numbers = {k for first, last in mine for k in range(first, last + 1)}
    assert left == numbers - {k for first, last in theirs for k in range(first, last + 1)}
    assert json.dumps(subtract(mine, [])) == json.dumps(mine)
