"""A cloud's ingest for the gateway's tests, over HTTPS; fails by ``mode``."""

from __future__ import annotations

import time
from threading import Event, Lock
from typing import TYPE_CHECKING, Self

import cbor2
import orjson

from eskin.wire.frames import Layout, content_hash
from eskin.wire.messages import Kind
from tests.support.processes import free_port
from tests.unit.gateway.https_server import HttpsServer

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType

    from eskin.identity import Identity


class StubCloud:
    """Stores in memory, each plaintext once.

    ``mode``: ok, error, busy, flooded, nonsense, short, slow, reject, large. ``commands`` are given
    to the gateway, a node's id and bytes; ``held`` is what it said last that it has. ``failing``
    are bodies that break it, ``hanging`` bodies to which it gives no answer until it is released.
    ``descriptions`` are what it has of nodes; it stores no frame or statements without them.
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
        self.descriptions: dict[tuple[str, bytes], bytes] = {}
        self.failing: set[bytes] = set()
        self.hanging: set[bytes] = set()
        self.faults: list[str] = []
        self.commands: dict[str, tuple[int, bytes]] = {}
        self.held: dict[tuple[str, int], bool] = {}
        self.alarms: list[tuple[int, str, str]] = []
        self.published: int | None = None
        self._storing = Lock()
        self._server: HttpsServer | None = None

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
        self._server = HttpsServer(self._identity, self.port, self._respond, clients=True)

    def end(self) -> None:
        """Be away."""
        self.release.set()
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def _respond(
        self, path: str, headers: Mapping[str, str], body: bytes
    ) -> tuple[int, dict[str, str], bytes]:
        self._check(headers)
        if path.endswith("/deliveries"):
            status, answer = self._deliver(body)
        elif path.endswith("/descriptions"):
            status, answer = 200, self._describe(body)
        else:
            self.requests += 1
            status, answer = self._answer(body)
        more = {"retry-after": self.retry_after} if status in {429, 503} else {}
        return status, {"content-type": "application/json", **more}, answer

    def _answer(self, body: bytes) -> tuple[int, bytes]:
        items = cbor2.loads(body)
        mode = self.mode
        if mode == "slow":
            self.release.wait()
        refusals = {
            "error": (500, b"oops"),
            "busy": (503, b"later"),
            "flooded": (429, b"less"),
            "nonsense": (200, b"<html>"),
        }
        if mode in refusals:
            return refusals[mode]
        if any(body in self.hanging for _, body in items):
            self.release.wait()
        if any(body in self.failing for _, body in items):
            return 500, b"oops"
        if mode == "large" and len(items) > 2:
            return 413, b"too large"
        if mode == "short":
            return 200, orjson.dumps({"items": []})
        results = [self._store(node, data) for node, data in items]
        return 200, orjson.dumps({"items": results})

    def _deliver(self, body: bytes) -> tuple[int, bytes]:
        asked = cbor2.loads(body)
        self.held = {(node, number): sent for node, number, sent in asked["held"]}
        deadline = time.monotonic() + asked["wait_s"]
        while True:
            commands, held = dict(self.commands), self.held  # others may change them meanwhile
            wanted = {(node, number) for node, (number, _) in commands.items()}
            give = [
                [node, number, signed]
                for node, (number, signed) in commands.items()
                if (node, number) not in held
            ]
            drop = [list(place) for place in held if place not in wanted]
            alarms = self._alarms_after(asked["published"])
            if give or drop or alarms or self._server is None or time.monotonic() > deadline:
                return 200, cbor2.dumps({"give": give, "drop": drop, "alarms": alarms})
            time.sleep(0.02)

    def _alarms_after(self, published: int | None) -> list[list[object]]:
        self.published = published
        latest = {monitor: number for number, monitor, _ in self.alarms}
        return [
            [number, monitor, document]
            for number, monitor, document in self.alarms
            if (number == latest[monitor] if published is None else number > published)
        ]

    def _describe(self, body: bytes) -> bytes:
        items = cbor2.loads(body)
        self.descriptions |= {(node, content_hash(data)): data for node, data in items}
        return orjson.dumps({"items": [{"result": "stored", "reason": None}] * len(items)})

    def _lacking(self, node: str, data: bytes) -> list[bytes]:
        """Hashes of descriptions by which a message is read, and which were not posted."""
        described = {bytes((1, Kind.FRAME)), bytes((1, Kind.STATEMENTS))}
        fields = cbor2.loads(data) if data[1:3] in described else {}
        if 4 not in fields:
            return []
        layout = self.descriptions.get((node, fields[4]))
        if layout is None:
            return [fields[4]]
        patches = Layout.decode(layout).patches
        return [patch for patch in patches if (node, patch) not in self.descriptions]

    def _store(self, node: str, data: bytes) -> dict[str, object]:
        if self.mode == "reject":
            return {"result": "rejected", "reason": "not wanted"}
        if lacking := self._lacking(node, data):
            want = [each.hex() for each in lacking]
            return {"result": "unknown_layout", "reason": "post it", "want": want}
        with self._storing:
            if (node, data) in self.stored:
                self.duplicates += 1
                return {"result": "duplicate", "reason": None}
            self.stored.append((node, data))
            return {"result": "stored", "reason": None}

    def _check(self, headers: Mapping[str, str]) -> None:
        """Whatever is not as agreed is a fault, which the fixture finds in the end."""
        if headers["content-type"] != "application/cbor":
            self.faults.append("type")
