"""The cloud: its application over ASGI, and its store, which writes in the caller's thread."""

from __future__ import annotations

import asyncio
import sqlite3
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Final

import cbor2
import httpx
import orjson
from cryptography.hazmat.primitives.serialization import Encoding
from eskin_cloud.app import gateway_application
from eskin_cloud.jobs.missing_messages import look
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.service import make_cloud
from eskin_cloud.settings import CloudSettings, GatewaysSection, StoreSection
from eskin_cloud.store import Store
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import event
from sqlalchemy.engine import Engine
from sqlalchemy.exc import OperationalError

from eskin.errors import StoreError
from tests.robustness.simulation.faults import CLOUD
from tests.robustness.simulation.timeline import EPOCH, SECOND
from tests.support.asgi import Answer, ask

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from sqlalchemy import Connection

    from tests.robustness.simulation.parties import Parties
    from tests.robustness.simulation.world import World

_JOBS_S: Final = 3.0

_clouds: dict[str, Cloud] = {}
"""By the path of their stores, for the listener below."""


@event.listens_for(Engine, "commit")
def _before_commit(connection: Connection) -> None:
    """Let a commit fail, which SQLAlchemy then rolls back."""
    cloud = _clouds.get(str(connection.engine.url.database))
    if cloud is not None and cloud.fails_now():
        full = sqlite3.OperationalError("database or disk is full")
        raise OperationalError("COMMIT", {}, full)


class _Here(ThreadPoolExecutor):
    """Runs in the caller's thread what the application would run in another one."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - it is the future's
            future.set_exception(error)
        return future


class Cloud:
    """The cloud.

    Args:
        world: What it is part of.

    Attributes:
        path: Its store.
        running: Whether it answers.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self.path = world.parties.store
        self.path.write_bytes(world.parties.empty_store)
        self._chains = {name: _pem(world.parties, name) for name in world.parties.gateways}
        self._latency = world.timeline.draws("jobs of the cloud")
        self.running = False
        self._life = 0
        self._dies_in_commit = False
        self._start()

    def now(self) -> int:
        """UTC ns, as its clock has it."""
        off = self._world.faults.lasting(CLOUD, "has its clock set") is not None
        return EPOCH + self._world.timeline.now + (3600 * SECOND if off else 0)

    def fails_now(self) -> bool:
        """Whether the commit that begins now fails."""
        if not self.running or not self._answering:
            return False
        dying = self._world.faults.once(CLOUD, "dies before a commit")
        if dying is not None:
            self._dies_in_commit = True
            self._lasts = dying.lasts
        return self._dies_in_commit or self._world.faults.often(CLOUD, "cannot commit")

    def _start(self) -> None:
        self._life += 1
        self._dies_in_commit = self._answering = False
        self.store = Store(self.path, clock=self.now, threaded=False, readers=1)
        settings = CloudSettings(
            store=StoreSection(path=self.path),
            gateways=GatewaysSection(identity=self._world.parties.cloud.directory),
        )
        self._loop = asyncio.new_event_loop()
        self._loop.set_default_executor(_Here(1))
        self._cloud = make_cloud(settings, self.store, clock=self.now)
        self._app = gateway_application(self._cloud)
        self.running = True
        _clouds[str(self.path)] = self
        self._world.timeline.note(CLOUD, "starts")
        self._schedule_jobs()

    def die(self, lasts: float) -> None:
        """Lose all but the file, and start again after so many seconds."""
        if self.running:
            self._world.timeline.note(CLOUD, "dies")
            self.close()
            self._world.timeline.after(lasts, self._start)

    def close(self) -> None:
        """Close the store."""
        if self.running:
            self.running = False
            self._life += 1
            _clouds.pop(str(self.path), None)
            self._loop.close()
            self.store.close()

    def answer(
        self, gateway: str, path: str, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> httpx.Response:
        """Answer a request of a gateway.

        Raises:
            httpx.HTTPError: The cloud is dead, or dies meanwhile.
        """
        if not self.running:
            raise httpx.ConnectError("the cloud is dead")
        name = path.rpartition("/")[2]
        if self._world.faults.lasting(CLOUD, "is unavailable"):
            self._world.timeline.note(CLOUD, f"answers 503 to {gateway}: {name}")
            return httpx.Response(503)
        answer: Answer = self._run(self._ask(gateway, path, headers, body))
        asked = _items(body) if name == "ingest" else []
        self._world.timeline.note(CLOUD, _shown(gateway, name, asked, answer))
        if self._dies_in_commit:
            self.die(self._lasts)
            raise httpx.RemoteProtocolError("the cloud died")
        if name == "ingest" and answer.status == httpx.codes.OK:
            self._world.laws.check_answer(asked, answer.body)
        dying = self._world.faults.once(CLOUD, "dies after a commit")
        if dying is not None:
            self.die(dying.lasts)
            raise httpx.RemoteProtocolError("the cloud died")
        return httpx.Response(
            answer.status, headers=list(answer.headers.items()), content=answer.body
        )

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        self._answering = True
        try:
            return self._loop.run_until_complete(work)
        finally:
            self._answering = False

    async def _ask(
        self, gateway: str, path: str, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> Answer:
        tls = {"tls": {"client_cert_chain": self._chains[gateway]}}
        answer = await ask(self._app, "POST", path.encode(), headers, body, extensions=tls)
        await self._cloud.gateway_contacts.written()
        return answer

    # Jobs.

    def _schedule_jobs(self) -> None:
        life = self._life

        def work() -> None:
            if life == self._life:
                self._do_jobs()
                if life == self._life:
                    self._schedule_jobs()

        self._world.timeline.after(_JOBS_S + self._latency.uniform(0.0, 0.5), work)

    def _do_jobs(self) -> None:
        for name, job in (("sweeps", sweep), ("looks for missing", look)):
            try:
                self._run(job(self._cloud))
            except StoreError:
                self._world.timeline.note(CLOUD, f"{name}: fails")
            if self._dies_in_commit:
                self.die(self._lasts)
                return


def _pem(parties: Parties, name: str) -> tuple[str, ...]:
    chain = parties.gateways[name].chain
    return tuple(each.public_bytes(Encoding.PEM).decode() for each in chain)


def _items(body: bytes) -> list[tuple[str, int, int]]:
    """Node, boot and sequence of each message of a batch."""
    found = []
    for node, data in cbor2.loads(body):
        message = ParsedMessage.parse(node, data).message
        assert message is not None, "a gateway sent what cannot be read"
        found.append((node, *message.position))
    return found


def _shown(gateway: str, name: str, asked: list[tuple[str, int, int]], answer: Answer) -> str:
    """A line of the history."""
    if name != "ingest" or answer.status != httpx.codes.OK:
        return f"answers {answer.status} to {gateway}: {name}"
    items = orjson.loads(answer.body)["items"]
    results = [
        f"{n}/{b}/{k}:{item['result']}" for (n, b, k), item in zip(asked, items, strict=True)
    ]
    return f"answers {gateway}: {' '.join(results)}"
