"""Whoever waits for the turn to change the CA keeps nobody else waiting."""

from __future__ import annotations

import asyncio
import socket
import ssl
import time
from contextlib import AsyncExitStack, ExitStack, suppress
from datetime import timedelta
from threading import Thread
from typing import TYPE_CHECKING, Self

import httpx
import pytest
from cryptography.hazmat.primitives import serialization

from authority import desk
from authority.application import create_application
from authority.requests import make_request
from authority.service import Server
from authority.settings import AuthoritySection
from authority.tokens import TOKENS_FILE, Tokens
from eskin.errors import LockedError
from eskin.identity import Authority, IdentityKind, client_context, new_key, turn
from eskin.lockfile import LockFile
from tests.processes import free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

pytestmark = pytest.mark.anyio
HOUR = timedelta(hours=1)
NODE = IdentityKind.NODE


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


class Rig:
    """A CA service without a socket, and another process that may have the turn."""

    def __init__(self, folder: Path) -> None:
        self.authority = Authority.open(folder)
        self.tokens = Tokens(folder / TOKENS_FILE)
        app = create_application(self.authority, self.tokens, lifetime=HOUR, grace=HOUR)
        self.client = httpx.AsyncClient(
            transport=httpx.ASGITransport(app), base_url="https://ca", timeout=30
        )

    def token(self, name: str) -> str:
        return self.tokens.create(NODE, name, (), HOUR, lines=0)

    async def enrol(
        self, token: str, name: str, key: ec.EllipticCurvePrivateKey | None = None
    ) -> httpx.Response:
        request = make_request(key or new_key(), name)
        made = request.public_bytes(serialization.Encoding.PEM).decode()
        return await self.client.post("/enrol", json={"token": token, "request": made})

    def others_turn(self) -> LockFile:
        return LockFile(self.authority.directory / "ledger.jsonl")


@pytest.fixture
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    made = Rig(tmp_path / "ca")
    async with made.client:
        yield made


async def test_others_are_answered_while_somebody_waits(rig: Rig) -> None:
    token = rig.token("palm")
    with rig.others_turn():
        enrolling = asyncio.create_task(rig.enrol(token, "palm"))
        await asyncio.sleep(0.1)
        before = time.monotonic()
        paths = ("/healthz", "/roots", "/revocations/node", "/revoked/node")
        statuses = [(await rig.client.get(path)).status_code for path in paths]
        assert statuses == [200] * 4
        assert time.monotonic() - before < 3
        assert not enrolling.done()
    assert (await enrolling).status_code == 200


async def test_whoever_is_refused_does_not_wait_for_the_turn(rig: Rig) -> None:
    used = rig.token("palm")
    assert (await rig.enrol(used, "palm")).status_code == 200
    with rig.others_turn():
        before = time.monotonic()
        answers = [await rig.enrol(token, "palm") for token in ("guess", used)]
        answers.append(await rig.client.post("/renew", json={"signed": "AA=="}))
        assert [answer.status_code for answer in answers] == [403] * 3
        assert time.monotonic() - before < 3


async def test_only_so_many_wait_and_not_for_ever(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(desk, "MOST", 3)
    monkeypatch.setattr(desk, "PATIENCE_S", 0.2)
    monkeypatch.setattr(turn, "PATIENCE_S", 0.6)
    tokens = [rig.token(f"skin{k}") for k in range(5)]
    with rig.others_turn():
        tasks = [
            asyncio.create_task(rig.enrol(token, f"skin{k}")) for k, token in enumerate(tokens)
        ]
        await asyncio.sleep(0.15)
        assert [task.done() for task in tasks] == [False] * 3 + [True] * 2
        answers = await asyncio.gather(*tasks)
    assert [answer.status_code for answer in answers] == [503] * 5
    assert all(answer.headers["retry-after"] for answer in answers)
    assert (await rig.enrol(tokens[0], "skin0")).status_code == 200


def damage_ledger(folder: Path) -> None:
    with (folder / "ledger.jsonl").open("ab") as ledger:
        ledger.write(b"no line\n")


def lose_key(folder: Path) -> None:
    (folder / "node.key").unlink()


def spoil_root(folder: Path) -> None:
    (folder / "root.pem").write_bytes(b"no certificate")


@pytest.mark.parametrize("harm", [damage_ledger, lose_key, spoil_root])
async def test_party_comes_again_where_the_ca_itself_is_at_fault(
    rig: Rig, harm: Callable[[Path], None]
) -> None:
    token, key, folder = rig.token("palm"), new_key(), rig.authority.directory
    rig.authority.issue(NODE, "sole", new_key().public_key())
    names = "ledger.jsonl", "node.key", "root.pem"
    good = {path: path.read_bytes() for path in (folder / name for name in names)}
    harm(folder)
    answer = await rig.enrol(token, "palm", key)
    assert answer.status_code == 503
    assert answer.headers["retry-after"]
    assert str(folder) not in answer.text, "strangers need not know"
    for path, content in good.items():
        path.write_bytes(content)
        path.chmod(0o600)
    assert (await rig.enrol(token, "palm", key)).status_code == 200


def served(folder: Path) -> tuple[Server, str]:
    own = AuthoritySection(directory=folder / "ca", port=free_port(), names=("127.0.0.1",))
    authority = Authority.open(own.directory)
    tokens = Tokens(own.directory / TOKENS_FILE)
    app = create_application(authority, tokens, lifetime=HOUR, grace=HOUR)
    return Server(app, own, authority), f"https://127.0.0.1:{own.port}"


class Serving:
    """A CA service in this process."""

    def __init__(self, folder: Path) -> None:
        self.server, self.url = served(folder)
        self.port = int(self.url.rsplit(":", 1)[1])
        self.ca = folder / "ca"

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self.server.serve())
        await asyncio.to_thread(wait_until, lambda: self.server.started, "it listens", seconds=20)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.server.should_exit = True
        await self._task

    async def health(self, come_from: str) -> int:
        context = client_context(self.ca / "root.pem")
        transport = httpx.AsyncHTTPTransport(verify=context, local_address=come_from)
        async with httpx.AsyncClient(transport=transport, timeout=5) as client:
            return (await client.get(f"{self.url}/healthz")).status_code


async def test_service_that_renews_itself_answers_meanwhile(tmp_path: Path) -> None:
    serving = Serving(tmp_path)
    Authority(serving.ca).rotate(IdentityKind.SERVER)
    with LockFile(serving.ca / "ledger.jsonl"):
        async with serving:
            before = time.monotonic()
            await asyncio.sleep(1.5)
            assert await serving.health("127.0.0.1") == 200
            assert time.monotonic() - before < 5


@pytest.mark.parametrize("fault", [LockedError, RuntimeError])
async def test_service_outlives_whatever_fails_while_it_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: type[Exception]
) -> None:
    looks = []

    def fail(_: Server) -> None:
        looks.append(1)
        raise fault(tmp_path)

    monkeypatch.setattr(Server, "_look", fail)
    async with Serving(tmp_path) as serving:
        await asyncio.sleep(2.5)
        assert len(looks) >= 2
        assert await serving.health("127.0.0.1") == 200


async def test_silent_connections_to_the_ca_leave_room_for_others(tmp_path: Path) -> None:
    async with Serving(tmp_path) as serving, AsyncExitStack() as stack:
        readers = []
        for _ in range(300):
            reader, writer = await asyncio.open_connection("127.0.0.1", serving.port)
            stack.callback(writer.close)
            readers.append(reader)
        await asyncio.sleep(1)
        gone = 0
        for reader in readers:
            with suppress(TimeoutError, ConnectionError, ssl.SSLError):
                async with asyncio.timeout(0.002):
                    await reader.read(1)
                gone += 1
            gone += reader.exception() is not None
        assert gone >= 10
        assert await serving.health("127.0.0.2") == 200


def is_ended(guest: socket.socket) -> bool:
    try:
        return guest.recv(1, socket.MSG_DONTWAIT | socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_silent_connections_are_counted_on_the_loop_that_the_service_chooses(
    tmp_path: Path,
) -> None:
    serving = Serving(tmp_path)
    thread = Thread(target=serving.server.run)
    thread.start()
    try:
        wait_until(lambda: serving.server.started, "it listens", seconds=20)
        with ExitStack() as stack:
            guests = [
                stack.enter_context(socket.create_connection(("127.0.0.1", serving.port)))
                for _ in range(300)
            ]
            wait_until(lambda: sum(map(is_ended, guests)) >= 10, "some are refused", seconds=8)
    finally:
        serving.server.should_exit = True
        thread.join()
