"""A revocation counts in requests that are open: a caller that is judged once is judged again."""

from __future__ import annotations

import asyncio
import socket
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.access import (
    Scope,
    create_login_code,
    create_token,
    digest,
    list_sessions,
    redeem_login_code,
    revoke_session,
    revoke_token,
    token_id,
)
from eskin_cloud.api.dependencies import cookie_name
from eskin_cloud.api.middleware import answer as module
from eskin_cloud.ingest.gateway_trust import _GOOD_S
from eskin_cloud.settings import GatewaysSection
from eskin_cloud.store.write.audit_log import read_audit_entries

from eskin.identity import IdentityKind
from eskin.runtime.http_server.protocol import HttpLimits
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import batch, problem, put, standing
from tests.unit.cloud.messages import CHANNEL, NODE, status, stretch
from tests.unit.cloud.orders import order, waiting_gateway
from tests.unit.eskin.test_connection_limits import GET, listening

if TYPE_CHECKING:
    from pathlib import Path

    from starlette import types as asgi

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """No judgement is good for a while."""
    monkeypatch.setattr(module, "_FRESH_S", 0.0)


async def test_revoked_gateway_that_waits_is_given_no_command(
    tmp_path: Path, identities: Identities
) -> None:
    server = identities.make(IdentityKind.SERVER, "server.cloud").directory
    listed = identities.authority.write_revocations(IdentityKind.GATEWAY)
    lists = tmp_path / "gateway.crl.pem"
    lists.write_bytes(listed.read_bytes())
    own = GatewaysSection(identity=server, revocations=lists)
    lost = identities.make(IdentityKind.GATEWAY, "gateway.waits")
    with standing(tmp_path, identities, gateways=own) as stand:
        await stand.ingest(batch(status(0), stretch(1)))
        stand.gateway = lost
        asked = await waiting_gateway(stand)
        identities.authority.revoke("gateway.waits")
        lists.write_bytes(identities.authority.write_revocations(IdentityKind.GATEWAY).read_bytes())
        assert (await order(stand, {"name": "calibrate"})).status_code == 202
        answer = await asyncio.wait_for(asked, 20.0)
    assert "revoked" in problem(answer, 403)
    assert answer.headers["connection"] == "close"
    assert _GOOD_S <= 1.0


async def stream_of(stand: Stand, path: str, cookie: str) -> asyncio.Queue[asgi.Message | None]:
    """What a session is sent, as it comes; ``None`` at the end."""
    sent: asyncio.Queue[asgi.Message | None] = asyncio.Queue()
    headers = [(b"host", b"cloud"), (b"cookie", f"{cookie_name(stand.cloud)}={cookie}".encode())]
    path, _, query = path.partition("?")
    scope: dict[str, Any] = {
        "type": "http", "method": "GET", "path": path, "raw_path": path.encode(),
        "query_string": query.encode(), "headers": headers, "http_version": "1.1",
        "scheme": "http", "server": ("cloud", 80), "client": ("127.0.0.1", 1), "root_path": "",
        "asgi": {"version": "3.0", "spec_version": "2.3"}, "extensions": {},
    }  # fmt: skip
    asked = asyncio.Event()

    async def receive() -> asgi.Message:
        if not asked.is_set():
            asked.set()
            return {"type": "http.request", "body": b"", "more_body": False}
        await asyncio.Event().wait()
        raise AssertionError

    async def send(message: asgi.Message) -> None:
        await sent.put(message)

    async def run() -> None:
        await stand.people(scope, receive, send)
        await sent.put(None)

    sent.task = asyncio.create_task(run())  # type: ignore[attr-defined]  # kept from collection
    return sent


async def session_of(stand: Stand) -> str:
    """A session that a login link opened."""
    store = stand.cloud.store
    code = create_login_code(store, lifetime=timedelta(minutes=5))
    opened = redeem_login_code(store, code, lifetime=3600 * SECOND, address="127.0.0.1")
    session = await asyncio.wrap_future(opened)
    assert session is not None
    return session


async def test_live_stream_of_a_revoked_session_sends_nothing_more(stand: Stand) -> None:
    await stand.ingest(batch(status(0)))
    session = await session_of(stand)
    sent = await stream_of(stand, "/api/v1/live", session)
    async with asyncio.timeout(20):
        start = await sent.get()
        assert start is not None
        assert start["status"] == 200
        while not (await sent.get() or {}).get("body"):
            pass
        with stand.cloud.store.read() as connection:
            (row,) = list_sessions(connection, now=stand.clock())
        assert revoke_session(stand.cloud.store, row["id"])
        assert not revoke_session(stand.cloud.store, row["id"])
        await stand.ingest(batch(stretch(1)))
        stated = b""
        while (message := await sent.get()) is not None:
            stated += message.get("body", b"")
    assert b"event: frame" not in stated


async def test_long_answer_breaks_off_between_its_pieces(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PIECE", 100)
    put(stand.cloud.store, status(0), stretch(1, [1.0] * 400, [2.0] * 400))
    path = f"/api/v1/series/{NODE}/{CHANNEL}"
    async with stand.client() as client:
        whole = (await client.get(path)).content
    assert len(whole) > 1000
    token = token_id(digest(stand.token))
    answered = 0
    original = module._ask

    def ask(checks: Any) -> None:
        nonlocal answered
        answered += 1
        if answered == 4:
            revoke_token(stand.cloud.store, token)
        original(checks)

    monkeypatch.setattr(module, "_ask", ask)
    said = bytearray()

    async def send(message: asgi.Message) -> None:
        said.extend(message.get("body", b""))

    async def receive() -> asgi.Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    headers = [(b"host", b"cloud"), (b"authorization", f"Bearer {stand.token}".encode())]
    scope = {
        "type": "http", "method": "GET", "path": path, "raw_path": path.encode(),
        "query_string": b"", "headers": headers, "http_version": "1.1", "scheme": "http",
        "server": ("cloud", 80), "client": ("127.0.0.1", 1), "root_path": "",
        "asgi": {"version": "3.0", "spec_version": "2.3"}, "extensions": {},
    }  # fmt: skip
    await stand.people(scope, receive, send)
    assert 0 < len(said) < len(whole)
    assert whole.startswith(bytes(said))


async def test_session_of_a_login_link_is_listed_and_revoked(stand: Stand) -> None:
    session = await session_of(stand)
    scopes = [Scope.ADMIN]
    admin = create_token(stand.cloud.store, scopes=scopes, name="root", lifetime=timedelta(hours=1))
    async with stand.client(token="") as browser, stand.client(token=admin) as client:
        browser.cookies.set(cookie_name(stand.cloud), session)
        assert (await browser.get("/api/v1/nodes")).status_code == 200
        problem(await browser.get("/api/v1/sessions"), 403)
        (row,) = (await client.get("/api/v1/sessions")).json()["items"]
        assert row["name"] == "login link"
        path = f"/api/v1/sessions/{row['id']}"
        assert (await client.delete(path)).status_code == 204
        problem(await client.delete(path), 404)
        assert (await client.get("/api/v1/sessions")).json()["items"] == []
        problem(await browser.get("/api/v1/nodes"), 401)
    with stand.cloud.store.read() as connection:
        assert "session revoked" in [row["action"] for row in read_audit_entries(connection)]


@pytest.mark.parametrize("asked", ["a-b", "bytes=b-a", "bytes=999999999-", "bytes=5-1", "bytes=0-"])
async def test_range_is_ignored(stand: Stand, asked: str) -> None:
    stand.cloud.dashboard.mkdir()
    (stand.cloud.dashboard / "index.html").write_text("<p>whole</p>")
    async with stand.client() as client:
        answer = await client.get("/", headers={"Range": asked})
    assert (answer.status_code, answer.text) == (200, "<p>whole</p>")


async def test_slow_reader_of_a_long_body_is_served_to_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("eskin.runtime.http_server.protocol._STALLED_S", 2.0)
    size = 4_000_000

    async def long(scope: asgi.Scope, receive: asgi.Receive, send: asgi.Send) -> None:
        del scope, receive
        head = [(b"content-length", str(size).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": head})
        await send({"type": "http.response.body", "body": bytes(size)})

    loop = asyncio.get_running_loop()
    async with listening(HttpLimits(head_s=2.0), module.AnswerMiddleware(long)) as port:
        with socket.socket() as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.setblocking(False)  # noqa: FBT003 - its only parameter
            await loop.sock_connect(client, ("127.0.0.1", port))
            await loop.sock_sendall(client, GET)
            taken = 0
            while part := await loop.sock_recv(client, 8192):
                taken += len(part)
                if taken >= size:
                    break
                await asyncio.sleep(0.006)  # three seconds in all
    assert taken >= size
