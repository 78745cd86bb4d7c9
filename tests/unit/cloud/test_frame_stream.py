"""The live stream of frames: each once or counted as dropped, and no more than a client may."""

from __future__ import annotations

import asyncio
import logging
import random
import socket
from contextlib import AsyncExitStack, suppress
from dataclasses import replace
from datetime import timedelta
from typing import TYPE_CHECKING

import cbor2
import httpx
import pytest
from eskin_cloud.access import Scope, create_token, digest, revoke_token, token_id
from eskin_cloud.api.dependencies import cookie_name
from eskin_cloud.api.middleware import answer
from eskin_cloud.live.feed import read_entries
from eskin_cloud.settings import LiveSection
from eskin_cloud.store.feed_entry import FEED_START
from websockets.exceptions import ConnectionClosed, InvalidStatus

from eskin.wire.frames import Frame
from eskin.wire.messages import Position
from tests.support.websocket_closing import close_code
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import batch, forget_recent, position, standing
from tests.unit.cloud.frame_clients import PATIENCE_S, Received, dial, serving
from tests.unit.cloud.messages import NODE, peak
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame, statements
from tests.unit.cloud.test_recheck import session_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
STRETCH = 100_000_000


def described(stand: Stand, *nodes: str) -> None:
    """Have nodes state their layout."""
    for node in nodes or (NODE,):
        describe(stand.cloud.store, HAND, *PATCHES, node=node)
        stand.admitted.add(node)


def stretch(number: int) -> tuple[Frame, Frame]:
    """Both pages of a stretch."""
    at = number * STRETCH
    return frame(2 * number, at=at), frame(2 * number + 1, page=1, at=at)


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """Nothing that clients do is a fault of the server."""
    yield
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


async def refusal(port: int, token: str = "", **options: object) -> int:
    """The status with which an upgrade is refused, as problem details."""
    with pytest.raises(InvalidStatus) as caught:
        await dial(port, token, **options)  # type: ignore[arg-type]
    response = caught.value.response
    assert response.headers["Content-Type"] == "application/problem+json"
    assert "default-src 'self'" in response.headers["Content-Security-Policy"]
    return response.status_code


async def test_frames_come_as_their_node_encoded_them(stand: Stand) -> None:
    described(stand)
    said = [*stretch(0), *stretch(1)]
    got = Received()
    async with serving(stand) as port, dial(port, stand.token) as connection:
        await stand.ingest(batch(*said))
        await got.read(connection, frames=4)
    assert got.frames == [(NODE, each.encode()) for each in said]
    assert got.layouts == [(NODE, HAND.content_hash)]
    assert got.skipped == 0


async def test_events_come_between_frames_as_in_the_stream_of_events(stand: Stand) -> None:
    described(stand)
    got = Received()
    async with serving(stand) as port, dial(port, stand.token) as connection:
        await stand.ingest(batch(frame(0), statements(1), frame(2), peak(3)))
        await got.read(connection, frames=2, events=3)
    listed = (await stand.get("/api/v1/events", order="asc")).json()["items"]
    assert sorted(got.events, key=str) == sorted(listed, key=str)
    places = [int(cursor) for cursor in got.cursors]
    assert places == sorted(places)


async def test_nodes_and_patches_are_selected_while_it_runs(stand: Stand) -> None:
    described(stand, NODE, "other")
    await stand.ingest(batch(frame(900), node="other"))
    got = Received()
    async with serving(stand) as port, dial(port, stand.token, node=("other",)) as connection:
        await stand.ingest(batch(*stretch(0)))
        await stand.ingest(batch(*stretch(0), node="other"))
        await got.read(connection, frames=2)
        assert {node for node, _ in got.frames} == {"other"}
        await connection.send('{"nodes": ["fingertip"], "patches": ["warm"]}')
        number = 1
        while got.frames[-1][0] != NODE:  # until the server has read it
            await stand.ingest(batch(*stretch(number)))
            await stand.ingest(batch(*stretch(number), node="other"))
            with suppress(TimeoutError):
                await asyncio.wait_for(got.read(connection, frames=len(got.frames) + 1), 0.2)
            number += 1
        sent = stretch(number)
        await stand.ingest(batch(*sent))
        await connection.send('{"nodes": null, "patches": null}')
        while len(Frame.decode(got.frames[-1][1]).patches) != 2:
            number += 1
            await stand.ingest(batch(*stretch(number)))
            with suppress(TimeoutError):
                await asyncio.wait_for(got.read(connection, frames=len(got.frames) + 1), 0.2)
    reduced = [Frame.decode(data) for node, data in got.frames if node == NODE]
    of_warm = [each for each in reduced if [one.patch for one in each.patches] == [1]]
    assert of_warm
    whole = {each.position: each for k in range(number + 1) for each in stretch(k)}
    for each in of_warm:
        assert each.patches[0].samples == whole[each.position].patches[1].samples


@pytest.mark.parametrize("recent", [3, 1000])
async def test_every_frame_comes_once_whatever_breaks_off(
    tmp_path: Path, identities: Identities, place: StoreLocation, recent: int
) -> None:
    chance = random.Random(recent)  # noqa: S311 - no secret
    total = 120
    with standing(tmp_path, identities, place=place, live=LiveSection(recent=recent)) as stand:
        described(stand)
        got = Received(cursor="0")
        async with serving(stand) as port:

            async def produce() -> None:
                for number in range(total):
                    await stand.ingest(batch(*stretch(number)))
                    await asyncio.sleep(chance.choice((0.0, 0.01)))

            producing = asyncio.create_task(produce())
            while len(got.frames) + got.skipped < 2 * total:
                async with asyncio.timeout(PATIENCE_S):
                    async with dial(port, stand.token, cursor=got.cursor) as connection:
                        for _ in range(chance.randint(1, 30)):
                            got.take(await connection.recv())
                            if len(got.frames) + got.skipped >= 2 * total:
                                break
            await producing
        sequences = [Frame.decode(data).position.sequence for _, data in got.frames]
        assert sequences == sorted(set(sequences))
        assert len(sequences) + got.skipped == 2 * total
        assert len(sequences) > total


async def test_client_that_comes_back_too_late_learns_how_much_it_missed(
    tmp_path: Path, identities: Identities
) -> None:
    with standing(tmp_path, identities, live=LiveSection(backlog=6)) as stand:
        described(stand)
        await stand.ingest(batch(*(each for k in range(10) for each in stretch(k))))
        got = Received()
        async with serving(stand) as port, dial(port, stand.token, cursor="1") as connection:
            await got.read(connection, frames=19)
        sequences = [Frame.decode(data).position.sequence for _, data in got.frames]
        assert sequences == list(range(20))[-6:]
        assert got.skipped == 19 - 6


async def test_client_that_comes_back_after_compaction_learns_that_frames_are_missing(
    stand: Stand,
) -> None:
    described(stand)
    await stand.ingest(batch(*stretch(0), *stretch(1), peak(4)))
    await asyncio.to_thread(compact_all, stand.cloud.store)
    late = [replace(each, position=Position(1, 5 + k)) for k, each in enumerate(stretch(2))]
    await stand.ingest(batch(*late))
    forget_recent(stand)
    async with serving(stand) as port, dial(port, stand.token, cursor="1") as connection:
        kinds: list[tuple[str, str, object]] = []
        while len(kinds) < 4:
            kind, *rest = cbor2.loads(await connection.recv(decode=False))
            if kind != "layout" and rest[1] != 0:
                kinds.append((kind, rest[0], rest[1]))
    assert [(kind, cursor) for kind, cursor, _ in kinds] == [
        # The latest position that nothing sealed may be before is the start by now.
        ("lagging", "0"), ("event", "5"), ("frame", "6"), ("frame", "7")
    ]  # fmt: skip
    assert kinds[0][2] is None


async def test_client_that_comes_back_too_late_after_compaction_learns_no_wrong_number(
    tmp_path: Path, identities: Identities
) -> None:
    with standing(tmp_path, identities, live=LiveSection(backlog=4)) as stand:
        described(stand)
        await stand.ingest(batch(*(each for k in range(4) for each in stretch(k))))
        await asyncio.to_thread(compact_all, stand.cloud.store)
        await stand.ingest(batch(*(each for k in range(4, 7) for each in stretch(k))))
        async with serving(stand) as port, dial(port, stand.token, cursor="1") as connection:
            kind, _, skipped = cbor2.loads(await connection.recv(decode=False))
            assert (kind, skipped) == ("lagging", 0)
            kind, _, skipped = cbor2.loads(await connection.recv(decode=False))
            assert (kind, skipped) == ("lagging", None)
            got = Received()
            await got.read(connection, frames=4)
    sequences = [Frame.decode(data).position.sequence for _, data in got.frames]
    assert sequences == [10, 11, 12, 13]


async def test_slow_client_gets_whole_stretches_and_the_newest_ones(stand: Stand) -> None:
    described(stand)
    got, total = Received(), 200
    loop = asyncio.get_running_loop()
    with socket.socket() as narrow:
        narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        narrow.setblocking(False)  # noqa: FBT003 - its only parameter
        async with serving(stand) as port:
            await loop.sock_connect(narrow, ("127.0.0.1", port))
            async with dial(port, stand.token, sock=narrow, max_queue=1) as connection:
                got.take(await connection.recv())
                for number in range(total):  # 100 ms each, by the clock of the cloud
                    stand.clock.now += STRETCH
                    await stand.ingest(batch(*stretch(number)))
                await got.read(connection, frames=2 * total)
    read = [Frame.decode(data) for _, data in got.frames]
    sequences = [each.position.sequence for each in read]
    assert sequences == sorted(set(sequences))
    assert len(sequences) + got.skipped == 2 * total
    assert got.skipped > 0
    assert sequences[-2:] == [2 * total - 2, 2 * total - 1]
    pages: dict[int, int] = {}
    for each in read:
        pages[each.ticks] = pages.get(each.ticks, 0) + 1
    assert set(pages.values()) == {2}


async def test_revoked_token_gets_nothing_more(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answer, "_FRESH_S", 0.0)
    described(stand)
    got = Received()
    async with serving(stand) as port, dial(port, stand.token) as connection:
        await stand.ingest(batch(*stretch(0)))
        await got.read(connection, frames=2)
        assert revoke_token(stand.cloud.store, token_id(digest(stand.token)))
        await stand.ingest(batch(*stretch(1)))
        assert await close_code(connection) == 1008


async def test_silent_stream_of_an_expired_token_is_closed(
    tmp_path: Path, identities: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answer, "_FRESH_S", 0.0)
    with standing(tmp_path, identities, live=LiveSection(heartbeat_s=0.05)) as stand:
        async with serving(stand) as port, dial(port, stand.token) as connection:
            await connection.recv()
            stand.clock.turn(7200.0)
            assert await close_code(connection) == 1008


async def test_caller_without_proof_or_scope_is_refused(stand: Stand) -> None:
    lifetime = timedelta(hours=1)
    other = create_token(stand.cloud.store, scopes=[Scope.ADMIN], name="a", lifetime=lifetime)
    async with serving(stand) as port:
        assert await refusal(port) == 401
        assert await refusal(port, "eskin_guess") == 401
        assert await refusal(port, other) == 403
        assert await refusal(port, stand.token, node=("unheard",)) == 404
        async with dial(port, stand.token, cursor="guess") as connection:
            assert await close_code(connection) == 4422


async def test_page_of_another_site_opens_no_stream_with_a_session(stand: Stand) -> None:
    session = await session_of(stand)
    cookie = {"Cookie": f"{cookie_name(stand.cloud)}={session}"}
    async with serving(stand) as port:
        for origin in (None, "null", "https://evil.example", "http://127.0.0.1:1", "http://[x"):
            assert await refusal(port, headers=cookie, origin=origin) == 403
        own = f"http://127.0.0.1:{port}"
        assert await refusal(port, headers={"Cookie": "x=y"}, origin=own) == 401
        async with dial(port, "", headers=cookie, origin=own) as connection:
            await connection.recv()
        # A token is no cookie: no browser adds it by itself.
        async with dial(port, stand.token, origin="https://tool.example") as connection:
            await connection.recv()


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ("{", 1007),
        ("[]", 1007),
        ('{"nodes": "all"}', 1007),
        ('{"node": []}', 1007),
        ('{"nodes": [1]}', 1007),
        (b"\xa0", 1003),
        ('{"nodes": ["' + "x" * 5000 + '"]}', 1009),
    ],
)
async def test_bad_message_closes_the_stream(stand: Stand, said: str | bytes, code: int) -> None:
    async with serving(stand) as port, dial(port, stand.token) as connection:
        await connection.send(said)
        assert await close_code(connection) == code
    assert stand.cloud.feed.subscribers == 0


async def test_flood_of_messages_closes_the_stream(stand: Stand) -> None:
    async with serving(stand) as port, dial(port, stand.token) as connection:
        with suppress(ConnectionClosed):
            for _ in range(100):
                await connection.send('{"nodes": null}')
        assert await close_code(connection) == 1008


@pytest.mark.nightly
async def test_a_thousand_upgrades_leave_room_for_others(
    tmp_path: Path, identities: Identities
) -> None:
    with standing(tmp_path, identities, live=LiveSection(subscribers=20)) as stand:
        async with serving(stand) as port, AsyncExitStack() as stack:
            statuses: dict[int, int] = {}

            async def upgrade() -> None:
                try:
                    await stack.enter_async_context(dial(port, stand.token))
                    status = 101
                except InvalidStatus as error:
                    status = error.response.status_code
                statuses[status] = statuses.get(status, 0) + 1

            for _ in range(40):
                await asyncio.gather(*(upgrade() for _ in range(25)))
            assert set(statuses) <= {101, 429, 503}
            assert 1 <= statuses[101] <= 45  # those of one instant are counted together
            assert stand.cloud.feed.subscribers == statuses[101]
            async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as client:
                assert (await client.get("/healthz")).status_code in {200, 429}


async def test_stopping_cloud_closes_streams(stand: Stand) -> None:
    async with serving(stand) as port, dial(port, stand.token) as connection:
        await connection.recv()
        stand.cloud.feed.close()
        assert await close_code(connection) == 1012


async def test_damaged_frame_is_left_out(stand: Stand) -> None:
    described(stand)
    await stand.ingest(batch(*stretch(0)))
    with stand.cloud.store.read() as connection:
        found = read_entries(connection, FEED_START.spans(position(100)))
    assert [entry.frame for entry in found if entry.frame] == [each.encode() for each in stretch(0)]
