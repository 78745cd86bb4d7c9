"""Which nodes are asked for short blocks: those at which somebody looks, and not too many."""

from __future__ import annotations

from contextlib import aclosing
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.live import Viewers
from eskin_cloud.live.stream import stream
from eskin_cloud.live.subscription import Subscription

from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import CHANNEL, NODE, block, status

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

NODES = [f"n{number}" for number in range(9)]


@pytest.fixture
def now() -> list[float]:
    return [1000.0]


@pytest.fixture
def viewers(now: list[float]) -> Viewers:
    return Viewers(most=3, lasting=10.0, clock=lambda: now[0])


def test_nobody_looks_at_anything_at_first(viewers: Viewers) -> None:
    assert viewers.watched(NODES) == []
    assert viewers.nodes == []


def test_what_two_look_at_is_watched_until_both_have_gone(viewers: Viewers) -> None:
    with viewers.looking({"n1", "n2"}):
        with viewers.looking({"n1"}):
            assert viewers.watched(NODES) == ["n1", "n2"]
        assert viewers.watched(["n1"]) == ["n1"]
        assert sorted(viewers.nodes) == ["n1", "n2"]
    assert viewers.watched(NODES) == []


def test_what_is_chosen_goes_before_what_comes_along(viewers: Viewers, now: list[float]) -> None:
    with viewers.looking(()):
        assert viewers.watched(NODES) == ["n0", "n1", "n2"]
        with viewers.looking(NODES[3:]):
            assert viewers.watched(NODES) == NODES[:6]
        # Places are held for as long as a look is good.
        now[0] += 9.0
        assert viewers.watched(["n8", "n1"]) == ["n1"]
        now[0] += 2.0
        assert viewers.watched(["n8", "n7", "n2"]) == ["n8", "n7"]
        assert viewers.watched(["n1", "n6"]) == ["n1"]


def test_what_another_process_says_is_good_for_a_while(viewers: Viewers, now: list[float]) -> None:
    viewers.hear(["n1", "n2"])
    assert viewers.watched(NODES) == ["n1", "n2"]
    now[0] += 9.0
    viewers.hear(["n2"])
    now[0] += 1.0
    assert viewers.watched(NODES) == ["n2"]


@pytest.mark.anyio
async def test_stream_has_the_gateway_told(stand: Stand) -> None:
    async def watched(number: int) -> Any:
        return (await stand.ingest(batch(block(number)))).json()["watched"]

    await stand.ingest(batch(status(0)))
    assert await watched(1) == {}
    for selection, looked_at in (
        (Subscription(frozenset(), frozenset(), 50), True),
        (Subscription(frozenset({NODE}), frozenset(), 50), True),
        (Subscription(frozenset(), frozenset({(NODE, CHANNEL)}), 50), True),
        (Subscription(frozenset({"palm"}), frozenset(), 50), False),
    ):
        told = stream(
            stand.cloud.feed,
            selection,
            viewers=stand.cloud.viewers,
            cursor=0,
            backlog=1000,
            heartbeat=30.0,
            reveal=lambda entry: [entry],
            sealed=True,
        )
        async with aclosing(told):  # type: ignore[type-var]  # a generator
            await anext(told)
            assert await watched(2) == ({NODE: 10.0} if looked_at else {})
        assert await watched(3) == {}
