"""Alarms reach real receivers: at least once, in their order, under one key, over faults."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any, Final

import httpx
import pytest
from eskin_cloud.access import Scope

from tests.support.processes import Running, accepts, free_port, wait_until
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities

SECRET: Final = b"not a secret, as it is in a test"
MONITOR: Final = "/api/v1/monitors/squeeze"


class Webhook(ThreadingHTTPServer):
    """A receiver that can refuse and hang."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.status = 204
        self.hang = threading.Event()
        self.hang.set()
        self.got: list[tuple[dict[str, str], bytes]] = []
        self.asked = 0

    @property
    def documents(self) -> list[dict[str, Any]]:
        """What it took."""
        return [json.loads(body) for _, body in self.got]


class _Handler(BaseHTTPRequestHandler):
    server: Webhook

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        self.server.asked += 1
        self.server.hang.wait(60)
        if self.server.status < 300:
            self.server.got.append((dict(self.headers.items()), body))
        self.send_response(self.server.status)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def listening() -> Iterator[Webhook]:
    with Webhook() as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield server
        finally:
            server.hang.set()
            server.shutdown()


class Presses:
    """A cloud whose monitor is raised and cleared."""

    def __init__(self, cloud: Service) -> None:
        self.cloud, self._next, self._ms = cloud, 0, 0
        self.bring(1.0)
        self.token = cloud.token(Scope.READ, Scope.OPERATE)

    def define(self, **more: Any) -> None:
        body = {"formula": f"{CHANNEL} > 2 F", "node": NODE, "clear_after_s": 0.0} | more
        with self.cloud.people(self.token) as client:
            answer = client.put(MONITOR, json=body)
        assert answer.status_code == 200, answer.text

    def bring(self, *values: float) -> None:
        """Samples of a millisecond each, after those before."""
        at = START + self._ms * DT
        said = stretch(self._next, list(values), [v + 0.5 for v in values], time=(at, at))
        self._next, self._ms = self._next + 1, self._ms + len(values)
        assert self.cloud.ingest(batch(said)).status_code == 200

    def press(self) -> None:
        """One episode."""
        self.bring(4.0, 4.0, 1.0, 1.0)

    def receivers(self) -> dict[str, dict[str, Any]]:
        with self.cloud.people(self.token) as client:
            items = client.get("/api/v1/receivers").json()["items"]
        return {each["name"]: each for each in items}


@pytest.fixture
def webhook() -> Iterator[Webhook]:
    with listening() as server:
        yield server


def service(
    folder: Path,
    identities: Identities,
    webhook: Webhook,
    *,
    more: str = "",
) -> Service:
    secret = folder / "secret"
    secret.write_text(f"whsec_{base64.b64encode(SECRET).decode()}\n")
    url = f"http://127.0.0.1:{webhook.server_port}/alarms"
    sections = (
        f"[alarms]\nwebhook_secret_file = '{secret}'\ntimeout_s = 2\nretry_max_s = 1\n"
        f"{more}\n[alarms.webhooks]\nops = '{url}'\n"
    )
    return Service(folder, identities, more=sections)


def test_each_change_is_delivered_in_order_over_refusals_hangs_and_kills(
    tmp_path: Path, identities: Identities, webhook: Webhook
) -> None:
    with service(tmp_path, identities, webhook) as cloud:
        presses = Presses(cloud)
        presses.define()
        presses.press()
        wait_until(lambda: len(webhook.got) == 2, "two changes are delivered")
        webhook.status = 500
        presses.press()
        wait_until(lambda: presses.receivers()["webhook ops"]["attempts"] >= 1, "it is refused")
        webhook.status, webhook.hang = 204, threading.Event()
        wait_until(lambda: webhook.asked >= 5, "it hangs")
        cloud.kill()
        webhook.hang.set()
        cloud.begin()
        wait_until(lambda: accepts(cloud.ingest_port) and accepts(cloud.port), "it is back")
        presses.press()
        wait_until(
            lambda: webhook.documents[-1]["number"] == 7 and len(webhook.got) >= 6,
            "all six changes are delivered",
        )
        wait_until(lambda: presses.receivers()["webhook ops"]["waiting"] == 0, "that is noted")
    numbers = [document["number"] for document in webhook.documents]
    assert sorted(numbers) == numbers
    assert sorted(set(numbers)) == [2, 3, 4, 5, 6, 7]
    assert [d["transition"] for d in webhook.documents][:2] == ["raised", "cleared"]
    keys: dict[int, set[str]] = {}
    for headers, body in webhook.got:
        document = json.loads(body)
        keys.setdefault(document["number"], set()).add(headers["webhook-id"])
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        expected = base64.b64encode(hmac.digest(SECRET, signed, hashlib.sha256)).decode()
        assert headers["webhook-signature"] == f"v1,{expected}"
        assert headers["idempotency-key"] == f'"{headers["webhook-id"]}"'
    assert all(len(each) == 1 for each in keys.values())
    assert len(set().union(*keys.values())) == 6


@pytest.mark.nightly
def test_alertmanager_shows_an_alarm_until_it_is_cleared(
    tmp_path: Path, identities: Identities, webhook: Webhook
) -> None:
    port = free_port()
    config = tmp_path / "alertmanager.yml"
    config.write_text("route: {receiver: none}\nreceivers: [{name: none}]\n")
    argv = [
        "prometheus-alertmanager",
        f"--config.file={config}",
        f"--storage.path={tmp_path}/alertmanager",
        f"--web.listen-address=127.0.0.1:{port}",
        "--cluster.listen-address=",
    ]
    url = f"http://127.0.0.1:{port}"

    def active() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = httpx.get(f"{url}/api/v2/alerts", timeout=60).json()
        return found

    more = f"alertmanager = '{url}'"
    with service(tmp_path, identities, webhook, more=more) as cloud:
        presses = Presses(cloud)
        presses.define(severity="critical", escalate_after_s=2.0)
        presses.bring(4.0, 4.0)
        wait_until(
            lambda: presses.receivers().get("alertmanager", {}).get("error") is not None,
            "it is away",
        )
        with Running(argv, log=tmp_path / "alertmanager.log"):
            wait_until(lambda: _answers(url), "it answers")
            wait_until(lambda: len(active()) == 1, "the alarm is active")
            wait_until(
                lambda: [a["labels"].get("escalated") for a in active()] == ["true"],
                "it is escalated, and the first alert has ended",
            )
            (alert,) = active()
            assert alert["labels"] == {
                "alertname": "squeeze",
                "severity": "critical",
                "alarm": "1",
                "escalated": "true",
            }
            presses.bring(1.0, 1.0)
            wait_until(lambda: active() == [], "the alarm is cleared")


def _answers(url: str) -> bool:
    try:
        return httpx.get(f"{url}/-/ready", timeout=60).status_code == 200
    except httpx.HTTPError:
        return False
