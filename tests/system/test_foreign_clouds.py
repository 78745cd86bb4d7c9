"""Clouds and cursors of another store or version: refused with the remedy, and nothing is lost."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import httpx
import pytest
from eskin_cloud.store.location import writing_engine
from eskin_cloud.store.schema.tables import versions
from eskin_cloud.store.version import VERSION
from sqlalchemy import delete, insert, update

from tests.unit.cloud.clouds import batch, problem
from tests.unit.cloud.messages import stretch
from tests.unit.cloud.service import PROGRAM, Service

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sqlalchemy import URL, Executable

    from tests.support.identities import Identities

pytestmark = pytest.mark.nightly

_OF_NEXT_VERSION: Final = (
    f"import eskin_cloud.store.version\neskin_cloud.store.version.VERSION = {VERSION + 1}\n"
)


@pytest.fixture
def place(make_place: Callable[[], URL]) -> URL:
    """An empty store."""
    return make_place()


@pytest.fixture
def one(tmp_path: Path, identities: Identities, place: URL) -> Iterator[Service]:
    """A running cloud, which has stored the first message."""
    with Service(tmp_path / "one", identities, place=place) as running:
        assert results(running, 0) == ["stored"]
        yield running


def results(cloud: Service, *numbers: int) -> list[str]:
    """The results of messages that a gateway brings in one batch."""
    answer = cloud.ingest(batch(*map(stretch, numbers)))
    return [item["result"] for item in answer.json()["items"]]


def change(place: URL, statement: Executable) -> None:
    """Change the store beneath its clouds."""
    engine = writing_engine(place)
    with engine.begin() as connection:
        connection.execute(statement)
    engine.dispose()


def require_refused(cloud: Service, token: str, remedy: str) -> None:
    """Check that a cloud serves neither gateways nor people, and gives the remedy."""
    with cloud.people(token) as client:
        answers = [client.get("/api/v1/nodes"), cloud.ingest(batch(stretch(1)))]
        assert client.get("/readyz").status_code == 503
    for answer in answers:
        assert remedy in problem(answer, 503)
        assert answer.json()["type"] == "/problems/store-unavailable"


def live(cloud: Service, token: str, last: str | None = None, *, frames: int = 0) -> str:
    """The id of a live stream after so many frames; it goes on after ``last``."""
    headers = {} if last is None else {"Last-Event-ID": last}
    with cloud.people(token) as client, client.stream("GET", "/api/v1/live", headers=headers) as a:
        if a.status_code != 200:
            a.read()
            raise httpx.HTTPStatusError("refused", request=a.request, response=a)
        found, kind, name = 0, "", ""
        for line in a.iter_lines():
            field, _, value = line.partition(": ")
            kind = value if field == "event" else kind
            name = value if field == "id" else name
            if not line and name:
                found, kind = found + (kind == "frame"), ""
                if found >= frames:
                    return name
    raise AssertionError("the stream ended")


def require_unknown(cloud: Service, token: str, name: str) -> None:
    """Check that a cloud rejects an id, by a problem that a client can tell from others."""
    with pytest.raises(httpx.HTTPStatusError) as refused:
        live(cloud, token, name)
    assert "leave it out" in problem(refused.value.response, 422)
    assert refused.value.response.json()["type"] == "/problems/unknown-cursor"


def test_cloud_with_another_cursor_key_is_refused_until_it_is_restarted(
    tmp_path: Path, identities: Identities, place: URL, one: Service
) -> None:
    token = one.token()
    name = live(one, token)
    change(place, update(versions).values(cursor_key=bytes(32)))
    require_refused(one, token, "restart this cloud")
    with Service(tmp_path / "two", identities, place=place) as two:
        require_unknown(two, token, name)
        assert results(two, 0, 1) == ["duplicate", "stored"]
        one.stop()
        one.log.unlink()
        one.start()
        assert results(one, 1, 2) == ["duplicate", "stored"]
        first = live(one, token)
        assert results(two, 3) == ["stored"]
        assert live(two, token, first, frames=1) != first, "both have one key"


def test_cloud_of_another_schema_version_is_refused_while_others_go_on(
    tmp_path: Path, identities: Identities, place: URL, one: Service
) -> None:
    later = Service(tmp_path / "later", identities, place=place)
    later.argv[2] = _OF_NEXT_VERSION + PROGRAM
    later.begin()
    assert later.ended() == 1
    said = f"the store has schema version {VERSION}, this program knows {VERSION + 1}; start the"
    assert said in later.output()
    assert results(one, 0, 1) == ["duplicate", "stored"]


def test_store_that_another_schema_version_takes_over_is_refused_and_loses_nothing(
    place: URL, one: Service
) -> None:
    token = one.token()
    name = live(one, token)
    change(place, insert(versions).values(version=VERSION + 1, applied=0))
    require_refused(one, token, f"schema version {VERSION + 1}, this program knows {VERSION}")
    change(place, delete(versions).where(versions.c.version == VERSION + 1))
    assert results(one, 0, 1) == ["duplicate", "stored"], "the gateway sends again"
    assert live(one, token, name, frames=1) != name


def test_cursor_of_another_store_is_refused_and_loses_nothing(
    tmp_path: Path, identities: Identities, make_place: Callable[[], URL], one: Service
) -> None:
    token = one.token()
    name = live(one, token)
    with Service(tmp_path / "other", identities, place=make_place()) as other:
        theirs = other.token()
        assert results(other, 0) == ["stored"]
        foreign = live(other, theirs)
        require_unknown(one, token, foreign)
        require_unknown(other, theirs, name)
        assert results(one, 1, 2) == ["stored", "stored"]
        with one.people(token) as client:
            page = client.get("/api/v1/events", params={"cursor": foreign})
        assert page.json()["type"] == "/problems/unknown-cursor"
        assert live(one, token, name, frames=2) != name, "its own goes on"
