"""An answer that cannot go on breaks off: its reader sees it, and the log has a line of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import httpx
import numpy as np
import pytest
from eskin_cloud.access import digest, revoke_token, token_id
from eskin_cloud.api.middleware.answer import AnswerMiddleware
from eskin_cloud.store import Store

from eskin.errors import StoreError
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.types import Message, Receive, Scope, Send

    from tests.support.identities import Identities

BLOCKS, SAMPLES = 300, 1000
"""Some 20 MB of text: more than what a server hands to the network at once."""


def fill(place: Path) -> None:
    lo = np.sin(np.arange(SAMPLES) / 9)
    times = [START + number * SAMPLES * DT for number in range(BLOCKS)]
    said = [stretch(number, lo, lo + 1, time=(begin, begin)) for number, begin in enumerate(times)]
    with Store(place) as store:
        put(store, *said)


@pytest.mark.nightly
def test_export_breaks_off_when_its_token_is_revoked(
    tmp_path: Path, identities: Identities
) -> None:
    place = tmp_path / "store.sqlite"
    fill(place)
    with Service(tmp_path / "cloud", identities, place=place) as service:
        token = service.token()
        with service.people(token) as client:
            asked = {"channel": f"{NODE}/{CHANNEL}"}
            headers = {"Accept": "text/csv"}
            with client.stream("GET", "/api/v1/export", params=asked, headers=headers) as answer:
                assert answer.status_code == 200, answer.read()
                pieces = answer.iter_bytes()
                assert next(pieces)
                with Store(place) as store:
                    assert revoke_token(store, token_id(digest(token)))
                with pytest.raises(httpx.RemoteProtocolError, match="incomplete"):
                    list(pieces)
        said = "answer broken off: path='/api/v1/export' reason=the token was revoked"
        service.wait_for(lambda: said in service.output(), "the log states it")
        assert "Traceback" not in service.output()


def answering(error: Exception, *, begun: bool) -> AnswerMiddleware:
    """An application whose answer meets an error."""

    async def app(_: Scope, __: Receive, send: Send) -> None:
        if begun:
            await send({"type": "http.response.start", "status": 200, "headers": []})
        raise error

    return AnswerMiddleware(app)


async def asked(app: AnswerMiddleware) -> list[str]:
    sent: list[str] = []

    async def receive() -> Message:
        return {"type": "http.request"}

    async def send(message: Message) -> None:
        sent.append(message["type"])

    await app({"type": "http", "path": "/api/v1/export"}, receive, send)
    return sent


@pytest.mark.anyio
async def test_store_that_fails_within_an_answer_ends_it(caplog: pytest.LogCaptureFixture) -> None:
    app = answering(StoreError("the disk is gone"), begun=True)
    assert await asked(app) == ["http.response.start"]
    assert "answer broken off: path='/api/v1/export' reason=the disk is gone" in caplog.text


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("error", "begun"), [(StoreError("away"), False), (ValueError("a bug"), True)]
)
async def test_refusals_and_faults_of_the_program_are_left_to_others(
    error: Exception, *, begun: bool
) -> None:
    with pytest.raises(type(error), match=str(error)):
        await asked(answering(error, begun=begun))
