"""How long a client counts as slow, what it is sent then, and that little is on the way."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.api.live import EventStream
from eskin_cloud.live.stream import (
    LONGEST_PAUSE_S,
    LONGEST_REST_S,
    PATIENCE_S,
    PAUSE_S,
    PROMPT_S,
    REST_S,
    Backpressure,
)

from eskin.runtime.http_server.protocol import PROMPT

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from starlette.types import Message

LATE_S = PATIENCE_S * 1.01


class _Reader:
    """Takes what it is notified, on a clock of its own."""

    def __init__(self) -> None:
        self.now = 0.0
        self.pace = Backpressure(lambda: self.now)

    def take(self, seconds: float) -> bool:
        """Take so long to make room; gives whether it counts as slow then."""
        self.now += seconds
        self.pace.note(seconds)
        return self.pace.slow


def test_patience_has_an_end() -> None:
    reader = _Reader()
    assert not reader.take(PATIENCE_S)
    assert reader.take(LATE_S)


@pytest.mark.parametrize(("took", "slow"), [(PROMPT_S, False), (PROMPT_S * 1.01, True)])
def test_who_was_slow_is_fast_again_with_room_at_once_after_a_rest(took: float, slow: bool) -> None:  # noqa: FBT001
    reader = _Reader()
    assert reader.take(LATE_S)
    reader.now += REST_S / 2
    assert reader.take(PROMPT_S)  # too early
    reader.now += REST_S
    assert reader.take(took) is slow


def test_client_without_room_even_so_is_sent_to_ever_more_seldom() -> None:
    reader = _Reader()
    pauses = []
    for _ in range(6):
        reader.take(LATE_S)
        pauses.append(reader.pace.pause)
    assert pauses == [PAUSE_S * 2**k for k in range(4)] + [LONGEST_PAUSE_S] * 2
    assert reader.take(PROMPT_S)
    reader.now += REST_S
    assert not reader.take(PROMPT_S)
    assert reader.pace.pause == 0


def test_tries_that_do_not_hold_get_rare() -> None:
    reader = _Reader()
    turns = [0.0]
    for _ in range(20_000):
        before = reader.pace.slow
        reader.take(PROMPT_S if before else LATE_S)
        if before and not reader.pace.slow:
            turns.append(reader.now)
    rests = [end - begin for begin, end in pairwise(turns)]
    assert rests[0] < REST_S * 1.5
    assert all(after > 1.5 * rest for rest, after in pairwise(rests[:5]))
    assert LONGEST_REST_S <= max(rests) < LONGEST_REST_S * 1.1


def test_one_delay_after_a_long_time_is_nothing_to_be_remembered() -> None:
    reader = _Reader()
    for _ in range(5):
        assert reader.take(LATE_S)
        reader.now += REST_S
        assert not reader.take(PROMPT_S)
        reader.now += 2 * REST_S


@pytest.mark.anyio
async def test_event_stream_has_as_little_as_can_be_wait_on_the_way() -> None:
    begun: list[bool] = []
    sent: list[bytes] = []

    async def stated() -> AsyncIterator[bytes]:
        assert begun
        yield b"data: 1\n\n"

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message.get("body", b""))

    extensions = {PROMPT: {"begin": lambda: begun.append(True)}}
    scope = {"type": "http", "asgi": {"spec_version": "2.4"}, "extensions": extensions}
    await EventStream(stated())(scope, receive, send)
    assert sent == [b"", b"data: 1\n\n", b""]
    await EventStream(stated())(scope | {"extensions": {}}, receive, send)
    assert begun == [True]
