"""Once a person is erased, an answer under way sends nothing more that was opened."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import pytest
from eskin_cloud.app import people_application
from eskin_cloud.store.schema.sealed_tables import erased_subjects
from sqlalchemy import insert

from eskin.wire.timestamp import SECOND
from tests.support.identities import SITE
from tests.unit.cloud.messages import DT, START
from tests.unit.cloud.sealing import CHANNEL, NODE, Site, beat, declared, keyed, physician, pulse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from eskin.wire.frames import Frame
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

FRAMES = 500
WINDOW = {"start": START - SECOND, "end": START + 3600 * SECOND}
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
EXPORT = f"/api/v1/export?{urlencode({'channel': f'{NODE}/{CHANNEL}', **WINDOW})}"
QUESTIONS = {
    "series as JSON": (f"{SERIES}?{urlencode({'points': 2000, **WINDOW})}", "application/json"),
    "series as CSV": (f"{SERIES}?{urlencode({'points': 2000, **WINDOW})}", "text/csv"),
    "threshold": (f"{SERIES}/threshold?{urlencode({'above': 0.5, **WINDOW})}", "application/json"),
    "export as CSV": (EXPORT, "text/csv"),
    "export as Arrow": (EXPORT, "application/vnd.apache.arrow.stream"),
    "events": ("/api/v1/events?limit=1000", "application/json"),
    "subject": ("/api/v1/subjects/{subject}/export", "*/*"),
}
SOON = {"series as JSON", "export as Arrow", "events", "subject"}
"""Those that are not only asked at night."""


@pytest.fixture
def stand(tmp_path: Path, identities: Identities, site: Site) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site) as made:
        yield made


def wave(sequence: int) -> Frame:
    """Six samples, of which every other one is above a half."""
    start = START + 6 * sequence * DT
    return pulse(sequence, [0.0, 1.0] * 3, [0.25, 1.25] * 3, time=(start, start))


def erase_here(stand: Stand, subject: str) -> None:
    stand.cloud.key_access.erase(SITE, subject)


def erase_elsewhere(stand: Stand, subject: str) -> None:
    """As another cloud on this store notes it."""
    row = {"site": SITE, "subject": subject, "erased": stand.clock()}
    stand.cloud.store.write(lambda c: c.execute(insert(erased_subjects), row)).result()


async def ask(
    stand: Stand, token: str, question: tuple[str, str], after_first: Callable[[], None]
) -> tuple[int, bytes, bool]:
    """Status, all that is sent, and whether the answer is whole; something happens under way."""
    url, accept = question
    path, _, text = url.partition("?")
    headers = [(b"authorization", f"Bearer {token}".encode()), (b"accept", accept.encode())]
    scope = {
        "type": "http", "http_version": "1.1", "method": "GET", "scheme": "http", "path": path,
        "raw_path": path.encode(), "query_string": text.encode(), "headers": headers,
        "client": ("127.0.0.1", 1), "server": ("cloud", 80), "root_path": "",
    }  # fmt: skip
    status, sent, whole = 0, b"", False

    requests = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> dict[str, Any]:
        if not requests:
            await asyncio.Event().wait()  # the client stays
        return requests.pop()

    async def send(message: Any) -> None:
        nonlocal status, sent, whole
        status = message.get("status", status)
        if body := message.get("body"):
            if not sent:
                after_first()
            sent += body
        whole = message["type"] == "http.response.body" and not message.get("more_body")

    await people_application(stand.cloud)(scope, receive, send)
    return status, sent, whole


@pytest.mark.parametrize(
    "erase", [erase_here, pytest.param(erase_elsewhere, marks=pytest.mark.nightly)]
)
@pytest.mark.parametrize(
    "question",
    [
        pytest.param(asked, id=name, marks=() if name in SOON else pytest.mark.nightly)
        for name, asked in QUESTIONS.items()
    ],
)
async def test_answer_under_way_ends_with_the_erasure(
    stand: Stand, site: Site, question: tuple[str, str], erase: Callable[[Stand, str], None]
) -> None:
    first, second = range(1, FRAMES + 1), range(FRAMES + 1, 2 * FRAMES + 1)
    for k in range(0, FRAMES, 100):
        await stand.ingest(site.batch(*(wave(sequence) for sequence in first[k : k + 100])))
        await stand.ingest(site.batch(*(beat(sequence) for sequence in second[k : k + 100])))
    await stand.ingest(site.batch(declared()))
    token, subject = physician(stand), site.ada.pseudonym
    question = question[0].format(subject=subject), question[1]

    status, sent, whole = await ask(stand, token, question, lambda: None)
    assert (status, whole) == (200, True), sent[:500]
    everything = len(sent)
    assert everything > 20_000

    status, sent, whole = await ask(stand, token, question, lambda: erase(stand, subject))
    assert (status, whole) == (200, False)
    assert len(sent) <= 16_384
