"""The cloud's application for people, asked by a caller who may do everything."""

from __future__ import annotations

import json
import logging
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from eskin_cloud.access import Scope, create_token
from eskin_cloud.app import people_application
from eskin_cloud.settings import LimitsSection

from tests.robustness.fuzz.asgi import Asker
from tests.robustness.fuzz.mutations.queries import IDS
from tests.support.identities import Identities
from tests.unit.cloud.clouds import Stand, standing

if TYPE_CHECKING:
    from contextlib import ExitStack
    from pathlib import Path

    from eskin_cloud.store import Store

    from tests.support.asgi import Answer


class People:
    """Asks, and checks each answer: it is no fault and no traceback, a refusal is problem details.

    Args:
        folder: Takes the cloud's files.
        stack: Keeps it open.

    Attributes:
        store: The cloud's.
        token: Of the one who asks.
    """

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        logging.getLogger("eskin_cloud").setLevel(logging.CRITICAL)
        generous = LimitsSection(
            requests_per_s=10**6, failures_per_min=10**6, refusals_per_min=1, body_bytes=65_536
        )
        (folder / "dashboard").mkdir()
        (folder / "dashboard" / "index.html").write_text("<!doctype html>")
        identities = Identities(folder / "identities")
        stand = stack.enter_context(standing(folder, identities, limits=generous))
        stand.cloud.feed.ids = IDS
        self.store: Store = stand.cloud.store
        self.token = _operator(stand)
        self._asker = Asker(people_application(stand.cloud))
        stack.callback(self._asker.close)

    def ask(
        self, method: str, target: bytes, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> Answer:
        """Send a request, with the token where there are no other credentials."""
        always = [(b"host", b"cloud"), (b"content-length", str(len(body)).encode())]
        headers = always + headers
        if not any(name == b"authorization" for name, _ in headers):
            headers.append((b"authorization", b"Bearer " + self.token))
        answer = self._asker.ask(method, b"/" + target.lstrip(b"/"), headers, body)
        _require_sound(answer)
        return answer


def require_intervals(document: Any) -> None:
    """Check that whatever has a lower and an upper bound in an answer is an interval."""
    if isinstance(document, dict):
        lo, hi = document.get("lo"), document.get("hi")
        if not isinstance(lo, list) or not isinstance(hi, list):
            lo, hi = [lo], [hi]
        for lower, upper in zip(lo, hi, strict=True):
            if isinstance(lower, int | float) and isinstance(upper, int | float):
                assert lower <= upper, document
        document = list(document.values())
    for item in document:
        if isinstance(item, dict | list):
            require_intervals(item)


def _require_sound(answer: Answer) -> None:
    assert answer.status < 500, answer
    assert b"Traceback" not in answer.body
    assert answer.headers[b"x-content-type-options"] == b"nosniff"
    kind = answer.headers.get(b"content-type", b"")
    if answer.status >= 400 and not kind.startswith(b"text/html"):  # the page to sign in
        assert kind == b"application/problem+json", answer
        assert json.loads(answer.body)["status"] == answer.status


def _operator(stand: Stand) -> bytes:
    lifetime = timedelta(days=3)
    token = create_token(stand.cloud.store, scopes=list(Scope), name="fuzz", lifetime=lifetime)
    return token.encode()
