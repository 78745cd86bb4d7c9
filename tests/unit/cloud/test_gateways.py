"""Gateways: contact, status, counts and lag."""

from __future__ import annotations

from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.ingest.gateway_status import HEADER
from eskin_cloud.store.row_digests import ROW_DIGEST
from eskin_cloud.store.schema.tables import gateways
from eskin_cloud.store.write.gateways import GatewayStatus, list_gateways, record_contact
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, event

from eskin.wire.timestamp import SECOND, format_timestamp
from tests.support.identities import SITE
from tests.unit.cloud.clouds import batch, problem
from tests.unit.cloud.messages import NODE, START, status, stretch
from tests.unit.cloud.orders import fetch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store import Store
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

MS = 1_000_000
STATE = {
    "messages": 7,
    "bytes": 4096,
    "capacity_bytes": 10**9,
    "oldest_ns": 12 * SECOND,
    "dead_letters": 2,
    "nodes": 3,
}


async def listed(stand: Stand) -> list[dict[str, Any]]:
    answer = await stand.get("/api/v1/gateways")
    assert answer.status_code == 200, answer.text
    found: list[dict[str, Any]] = answer.json()["items"]
    return found


async def test_gateway_is_listed_after_its_first_contact(stand: Stand) -> None:
    assert await listed(stand) == []
    time = (START, START + 3 * MS)
    said = batch(status(0), stretch(1, [1.0] * 5, [2.0] * 5, time=time, dt=10 * MS))
    assert (await stand.ingest(said, status=STATE)).status_code == 200
    now = stand.clock()
    (gateway,) = await listed(stand)
    assert gateway == {
        "id": "gateway.g1",
        "site": SITE,
        "health": "online",
        "first_heard": format_timestamp(now),
        "last_heard": format_timestamp(now),
        "nodes": 3,
        "spool": {
            "reported": format_timestamp(now),
            "messages": 7,
            "bytes": 4096,
            "capacity_bytes": 10**9,
            "oldest_ns": 12 * SECOND,
            "dead_letters": 2,
        },
        "stored": 2,
        "duplicate": 0,
        "rejected": 0,
        "latest": format_timestamp(now),
        "lag": {"lo_ns": now - time[1] - 40 * MS, "hi_ns": now - time[0] - 40 * MS},
    }
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["lag"] == gateway["lag"]


async def test_batch_without_messages_is_a_contact(stand: Stand) -> None:
    assert (await stand.ingest(cbor2.dumps([]), status=STATE)).status_code == 200
    (gateway,) = await listed(stand)
    assert gateway["last_heard"] == format_timestamp(stand.clock())
    assert gateway["stored"] == 0


async def test_batches_are_counted_and_the_last_status_stays(stand: Stand) -> None:
    said = batch(status(0), stretch(1))
    await stand.ingest(said, status=STATE)
    stand.clock.turn(3)
    await stand.ingest(said)
    await stand.ingest(cbor2.dumps([[NODE, b"nonsense"]]))
    (gateway,) = await listed(stand)
    counts = {name: gateway[name] for name in ("stored", "duplicate", "rejected")}
    assert counts == {"stored": 2, "duplicate": 2, "rejected": 1}
    assert gateway["last_heard"] == format_timestamp(stand.clock())
    assert gateway["spool"]["reported"] == gateway["first_heard"] != gateway["last_heard"]


async def test_contacts_of_many_batches_share_writes(stand: Stand) -> None:
    written: list[str] = []

    def note(*words: Any) -> None:
        if words[2].startswith(("INSERT INTO gateways", "UPDATE gateways")):
            written.append(words[2])

    await stand.ingest(batch(stretch(0)))
    begun = perf_counter()
    with listening(Engine, "before_cursor_execute", note):
        async with stand.ingest_client() as client:
            for number in range(1, 31):
                answer = await client.post("/api/v1/ingest", content=batch(stretch(number)))
                assert answer.status_code == 200, answer.text
        await stand.cloud.gateway_contacts.written()
    assert len(written) <= 2 + (perf_counter() - begun)
    (gateway,) = await listed(stand)
    assert gateway["stored"] == 31


@contextmanager
def listening(target: type[Engine], name: str, called: Callable[..., None]) -> Iterator[None]:
    event.listen(target, name, called)
    yield
    event.remove(target, name, called)


async def test_node_without_a_block_has_no_lag(stand: Stand) -> None:
    await stand.ingest(batch(status(0)))
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["lag"] is None
    assert (await listed(stand))[0]["lag"] is None


async def test_gateway_that_waits_for_an_answer_may_be_silent(stand: Stand) -> None:
    await fetch(stand, wait=0.0)
    for seconds, health in ((4, "online"), (2, "late"), (10, "offline")):
        stand.clock.turn(seconds)
        assert (await listed(stand))[0]["health"] == health
    with stand.cloud.store.read() as connection:
        (row,) = list_gateways(connection)
    stand.cloud.store.write(
        lambda c: record_contact(
            c, row["gateway"], site=SITE, condition=None, now=stand.clock(), wait=20 * SECOND
        )
    ).result(120)
    for seconds, health in ((24, "online"), (2, "late"), (10, "offline")):
        stand.clock.turn(seconds)
        assert (await listed(stand))[0]["health"] == health


@pytest.mark.parametrize(
    "state",
    [
        [],
        {},
        STATE | {"messages": -1},
        STATE | {"messages": 1.5},
        STATE | {"nodes": True},
        STATE | {"bytes": 2**63},
        STATE | {"messages": None},
        STATE | {"colour": 1},
        STATE | {"messages": "\ud800"},
        "x" * 2000,
        5,
    ],
)
async def test_status_that_is_not_as_agreed_is_refused(stand: Stand, state: Any) -> None:
    assert HEADER in problem(await stand.ingest(batch(status(0)), status=state), 422)
    assert await listed(stand) == []


async def test_only_gateways_report_and_only_readers_list(stand: Stand) -> None:
    async with stand.client(token="") as client:
        problem(await client.get("/api/v1/gateways"), 401)
    stand.gateway = None
    problem(await stand.ingest(batch(status(0)), status=STATE), 403)
    assert await listed(stand) == []


counts = st.integers(0, 2**40)
conditions = st.none() | st.builds(
    GatewayStatus, counts, counts, counts, st.none() | counts, counts, counts
)
EMPTY = {column.name: None for column in gateways.columns if column.name != ROW_DIGEST}


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(said=st.lists(st.tuples(st.sampled_from(["gateway.a", "gateway.b"]), conditions)))
def test_latest_status_of_each_gateway_is_stored(
    store: Store, said: list[tuple[str, GatewayStatus | None]]
) -> None:
    expected: dict[str, dict[str, Any]] = {}

    def work(connection: Connection) -> None:
        connection.execute(gateways.delete())
        for k, (name, condition) in enumerate(said):
            record_contact(connection, name, site=SITE, condition=condition, now=k)

    store.write(work).result(120)
    for k, (name, condition) in enumerate(said):
        fresh = {
            "gateway": name,
            "site": SITE,
            "first_heard": k,
            "stored": 0,
            "duplicate": 0,
            "rejected": 0,
        }
        row = expected.setdefault(name, EMPTY | fresh)
        row |= {"last_heard": k, "due": k}
        row |= {} if condition is None else {"reported": k, **condition._asdict()}
    with store.read() as connection:
        assert list_gateways(connection) == [expected[name] for name in sorted(expected)]


async def test_contact_from_the_future_is_not_online(stand: Stand) -> None:
    await stand.ingest(batch(status(0)))
    for seconds, health in ((-1, "online"), (-3600, "offline")):
        stand.clock.turn(seconds)
        (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
        assert (node["health"], (await listed(stand))[0]["health"]) == (health, health)
