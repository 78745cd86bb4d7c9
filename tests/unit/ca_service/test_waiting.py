"""Requests that wait for the CA's lock do not block other requests."""

from __future__ import annotations

import asyncio
import socket
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING, Self

import httpx
import pytest
from cryptography.hazmat.primitives import serialization
from eskin_ca import change_queue
from eskin_ca.app import create_application
from eskin_ca.csr import make_request
from eskin_ca.service import Server
from eskin_ca.settings import CaSection
from eskin_ca.tokens import TOKENS_FILE, Tokens

from eskin.errors import LockedError
from eskin.identity import CertificateAuthority, IdentityKind, client_context, new_key
from eskin.runtime.files import lock as file_lock
from eskin.runtime.files.lock import LockFile
from eskin.runtime.http_server.protocol import HttpLimits
from tests.support.identities import SITE
from tests.support.processes import free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

pytestmark = pytest.mark.anyio
HOUR = timedelta(hours=1)
NODE = IdentityKind.NODE
LONG_S = 100.0
"""Patience that lasts longer than anything here, where it is no question of its end."""


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture
def turns(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Paths that were locked; waits are long."""
    asked: list[Path] = []

    class Noted(LockFile):
        def __init__(self, path: Path, *, patience: float = 0.0) -> None:
            asked.append(path)
            super().__init__(path, patience=patience)

    monkeypatch.setattr(file_lock, "LockFile", Noted)
    monkeypatch.setattr(file_lock, "PATIENCE_S", LONG_S)
    monkeypatch.setattr(change_queue, "PATIENCE_S", LONG_S)
    return asked


async def until(condition: Callable[[], object], what: str) -> None:
    """Wait for something, while the event loop goes on."""
    await asyncio.to_thread(wait_until, lambda: bool(condition()), what)


class Rig:
    """A CA service without a socket, and another process that may have the turn."""

    def __init__(self, folder: Path) -> None:
        self.authority = CertificateAuthority.open(folder)
        self.tokens = Tokens(folder / TOKENS_FILE)
        app = create_application(self.authority, self.tokens, lifetime=HOUR, grace=HOUR)
        self.client = httpx.AsyncClient(
            transport=httpx.ASGITransport(app), base_url="https://ca", timeout=30
        )

    def token(self, name: str) -> str:
        return self.tokens.create(NODE, name, (), HOUR, lines=0, site=SITE)

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


async def test_others_are_answered_while_one_waits(rig: Rig, turns: list[Path]) -> None:
    token = rig.token("palm")
    with rig.others_turn():
        turns.clear()
        enrolling = asyncio.create_task(rig.enrol(token, "palm"))
        await until(lambda: turns, "it waits for its turn")
        paths = ("/healthz", "/roots", "/revocations/node", "/revoked/node")
        async with asyncio.timeout(60):
            statuses = [(await rig.client.get(path)).status_code for path in paths]
        assert statuses == [200] * 4
        assert not enrolling.done()
    assert (await enrolling).status_code == 200


async def test_caller_that_is_refused_does_not_wait_for_the_turn(
    rig: Rig, turns: list[Path]
) -> None:
    used = rig.token("palm")
    assert (await rig.enrol(used, "palm")).status_code == 200
    with rig.others_turn():
        turns.clear()
        answers = [await rig.enrol(token, "palm") for token in ("guess", used)]
        answers.append(await rig.client.post("/renew", json={"signed": "AA=="}))
        assert [answer.status_code for answer in answers] == [403] * 3
        assert turns == []


@pytest.mark.usefixtures("turns")
async def test_only_so_many_wait(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(change_queue, "MOST", 3)
    tokens = [rig.token(f"skin{k}") for k in range(5)]
    with rig.others_turn():
        tasks = [
            asyncio.create_task(rig.enrol(token, f"skin{k}")) for k, token in enumerate(tokens)
        ]
        await until(lambda: sum(task.done() for task in tasks) == 2, "who finds no room is stated")
        assert [task.done() for task in tasks] == [False] * 3 + [True] * 2
    answers = await asyncio.gather(*tasks)
    assert [answer.status_code for answer in answers] == [200] * 3 + [503] * 2
    assert all(answer.headers["retry-after"] for answer in answers[3:])


async def test_no_caller_waits_for_ever(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(change_queue, "PATIENCE_S", 0.2)
    monkeypatch.setattr(file_lock, "PATIENCE_S", 0.6)
    tokens = [rig.token(f"skin{k}") for k in range(3)]
    with rig.others_turn():
        stated = [rig.enrol(token, f"skin{k}") for k, token in enumerate(tokens)]
        answers = await asyncio.gather(*stated)
    assert [answer.status_code for answer in answers] == [503] * 3
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
    rig.authority.issue(NODE, "sole", new_key().public_key(), site=SITE)
    names = "ledger.jsonl", "node.key", "root.pem"
    good = {path: path.read_bytes() for path in (folder / name for name in names)}
    harm(folder)
    answer = await rig.enrol(token, "palm", key)
    assert answer.status_code == 503
    assert answer.headers["retry-after"]
    assert str(folder) not in answer.text, "outsiders need not know"
    for path, content in good.items():
        path.write_bytes(content)
        path.chmod(0o600)
    assert (await rig.enrol(token, "palm", key)).status_code == 200


def served(folder: Path) -> tuple[Server, str]:
    own = CaSection(directory=folder / "ca", port=free_port(), names=("127.0.0.1",))
    authority = CertificateAuthority.open(own.directory)
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
        await until(lambda: self.server.started, "it listens")
        return self

    async def __aexit__(self, *_: object) -> None:
        self.server.should_exit = True
        await self._task

    async def health(self, come_from: str) -> int:
        context = client_context(self.ca / "root.pem")
        transport = httpx.AsyncHTTPTransport(verify=context, local_address=come_from)
        async with httpx.AsyncClient(transport=transport, timeout=60) as client:
            return (await client.get(f"{self.url}/healthz")).status_code


async def test_service_that_renews_itself_answers_meanwhile(
    tmp_path: Path, turns: list[Path]
) -> None:
    serving = Serving(tmp_path)
    CertificateAuthority(serving.ca).rotate(IdentityKind.SERVER)
    with LockFile(serving.ca / "ledger.jsonl"):
        turns.clear()
        async with serving:
            await until(lambda: turns, "it would renew itself")
            assert await serving.health("127.0.0.1") == 200
            assert len(turns) == 1, "it still waits for its turn"


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
        await until(lambda: len(looks) >= 2, "it looks again")
        assert await serving.health("127.0.0.1") == 200


@pytest.fixture
def long_handshakes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rejected requests exceeded the queue, not the time limit."""
    monkeypatch.setattr("eskin_ca.service.HttpLimits", partial(HttpLimits, head_s=600.0))


@pytest.mark.usefixtures("long_handshakes")
async def test_silent_connections_to_the_ca_leave_room_for_others(tmp_path: Path) -> None:
    async with Serving(tmp_path) as serving:
        with silent_guests(serving.port) as guests:
            await until(lambda: sum(map(is_ended, guests)) >= 10, "the first are ended")
            assert await serving.health("127.0.0.2") == 200
            assert await serving.health("127.0.0.1") == 200


@contextmanager
def silent_guests(port: int) -> Iterator[list[socket.socket]]:
    """More of one address than there is room for."""
    with ExitStack() as stack:
        guests = [socket.create_connection(("127.0.0.1", port)) for _ in range(300)]
        for guest in guests:
            stack.enter_context(guest)
        yield guests


def is_ended(guest: socket.socket) -> bool:
    try:
        return guest.recv(1, socket.MSG_DONTWAIT | socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


@pytest.mark.usefixtures("long_handshakes")
def test_silent_connections_are_counted_on_the_loop_that_the_service_chooses(
    tmp_path: Path,
) -> None:
    serving = Serving(tmp_path)
    thread = Thread(target=serving.server.run)
    thread.start()
    try:
        wait_until(lambda: serving.server.started, "it listens")
        with silent_guests(serving.port) as guests:
            wait_until(lambda: sum(map(is_ended, guests)) >= 10, "some are refused")
    finally:
        serving.server.should_exit = True
        thread.join()
