"""A cloud's ingest for the gateway's tests: HTTPS, checks the token, misbehaves when told to."""

from __future__ import annotations

import asyncio
import hashlib
import time
from base64 import b64decode
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Self

import cbor2
import jwt
import orjson
import uvicorn

from eskin.identity import IdentityKind, Trust
from eskin.identity.identity import CHAIN_FILE, KEY_FILE
from tests.processes import accepts, free_port, wait_until

if TYPE_CHECKING:
    from types import TracebackType

    from eskin.identity import Identity


class StubCloud:
    """Stores in memory, each plaintext once.

    ``mode``: ok, error, busy, nonsense, short, slow, reject, large. ``commands`` are given to the
    gateway, a node's id and bytes; ``held`` is what it said last that it has.
    """

    def __init__(self, identity: Identity) -> None:
        self._identity = identity
        self.port = free_port()
        self.url = f"https://127.0.0.1:{self.port}/api/v1/ingest"
        self.mode = "ok"
        self.retry_after = "1"
        self.release = Event()
        self.stored: list[tuple[str, bytes]] = []
        self.duplicates = 0
        self.requests = 0
        self.faults: list[str] = []
        self.commands: dict[str, tuple[int, bytes]] = {}
        self.held: dict[tuple[str, int], bool] = {}
        self._tokens: set[str] = set()
        self._server: uvicorn.Server | None = None
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        self.begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()

    def begin(self) -> None:
        """Listen, always on the same port."""
        config = uvicorn.Config(
            self._application,
            host="127.0.0.1",
            port=self.port,
            ssl_certfile=self._identity.directory / CHAIN_FILE,
            ssl_keyfile=self._identity.directory / KEY_FILE,
            interface="asgi3",
            lifespan="off",
            ws="none",
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = Thread(target=self._server.run, daemon=True)
        self._thread.start()
        wait_until(lambda: accepts(self.port), "the stub cloud listens")

    def end(self) -> None:
        """Be away."""
        self.release.set()
        if self._server is not None and self._thread is not None:
            self._server.should_exit = True
            # A gateway that a failed test left running keeps its connection open.
            self._thread.join(20.0)
            self._server = None

    async def _application(self, scope: Any, receive: Any, send: Any) -> None:
        assert scope["type"] == "http"
        body = b""
        more = True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            body += message.get("body", b"")
            more = message.get("more_body", False)
        asked = dict(scope["headers"])
        if scope["path"].endswith("/deliveries"):
            status, answer = await self._deliver(asked, body)
        else:
            self.requests += 1
            status, answer = await self._answer(asked, body)
        headers = [(b"content-type", b"application/json")]
        if status in {429, 503}:
            headers.append((b"retry-after", self.retry_after.encode()))
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": answer})

    async def _answer(self, headers: dict[bytes, bytes], body: bytes) -> tuple[int, bytes]:
        self._check(headers, body)
        items = cbor2.loads(body)
        mode = self.mode
        if mode == "slow":
            await asyncio.to_thread(self.release.wait)
        refusals = {"error": (500, b"oops"), "busy": (503, b"later"), "nonsense": (200, b"<html>")}
        if mode in refusals:
            return refusals[mode]
        if mode == "large" and len(items) > 2:
            return 413, b"too large"
        if mode == "short":
            return 200, orjson.dumps({"items": []})
        return 200, orjson.dumps({"items": [self._store(node, data) for node, data in items]})

    async def _deliver(self, headers: dict[bytes, bytes], body: bytes) -> tuple[int, bytes]:
        self._check(headers, body)
        asked = cbor2.loads(body)
        self.held = {(node, number): sent for node, number, sent in asked["held"]}
        deadline = time.monotonic() + asked["wait_s"]
        while True:
            wanted = {(node, number) for node, (number, _) in self.commands.items()}
            give = [
                [node, number, signed]
                for node, (number, signed) in self.commands.items()
                if (node, number) not in self.held
            ]
            drop = [list(place) for place in self.held if place not in wanted]
            ending = self._server is None or self._server.should_exit
            if give or drop or ending or time.monotonic() > deadline:
                return 200, cbor2.dumps({"give": give, "drop": drop})
            await asyncio.sleep(0.02)

    def _store(self, node: str, data: bytes) -> dict[str, str | None]:
        if self.mode == "reject":
            return {"result": "rejected", "reason": "not wanted"}
        if (node, data) in self.stored:
            self.duplicates += 1
            return {"result": "duplicate", "reason": None}
        self.stored.append((node, data))
        return {"result": "stored", "reason": None}

    def _check(self, headers: dict[bytes, bytes], body: bytes) -> None:
        """Whatever is not as agreed is a fault, which the fixture finds in the end."""
        token = headers[b"authorization"].decode().removeprefix("Bearer ")
        chain = [b64decode(part) for part in jwt.get_unverified_header(token)["x5c"]]
        leaf = Trust(self._identity.root).verify(chain, IdentityKind.GATEWAY)
        claims = jwt.decode(
            token,
            leaf.public_key(),  # type: ignore[arg-type]  # P-256, as Trust made sure
            algorithms=["ES256"],
            audience="eskin-cloud",
            options={"require": ["iss", "aud", "iat", "exp", "jti"]},
        )
        good = {
            "issuer": claims["iss"] == "gateway.g1",
            "hash": claims["sha256"] == hashlib.sha256(body).hexdigest(),
            "lifetime": claims["exp"] - claims["iat"] <= 60,
            "fresh": claims["jti"] not in self._tokens,
            "type": headers[b"content-type"] == b"application/cbor",
        }
        self._tokens.add(claims["jti"])
        self.faults += [name for name, holds in good.items() if not holds]
