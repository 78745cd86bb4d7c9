"""Invalid batches, and a store that cannot be written."""

from __future__ import annotations

import gzip
import sqlite3
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.ingest.batch import read_batch
from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.settings import GatewaysSection
from eskin_cloud.store.schema.tables import dead_letters
from eskin_cloud.store.write.events import statement_rows
from eskin_cloud.store.write.presence import MOST_LAG
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import select, text

from eskin.errors import StoreError
from eskin.identity import IdentityKind
from eskin.wire.frames import EncodedFrame
from tests.unit.cloud.clouds import batch, count_frames, problem, standing
from tests.unit.cloud.messages import NODE, START, gap, peak, status, stretch

if TYPE_CHECKING:
    from pathlib import Path

    from sqlalchemy import Connection

    from eskin.wire.frames import Statements
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_batch_of_another_type_is_refused(stand: Stand) -> None:
    body = batch(stretch(0))
    for kind in ("application/json", "", "text/plain"):
        async with stand.ingest_client() as client:
            headers = {"Content-Type": kind}
            answer = await client.post("/api/v1/ingest", content=body, headers=headers)
        problem(answer, 415)


async def test_batch_is_one_commit(stand: Stand) -> None:
    await stand.ingest(batch(peak(1)))
    before = stand.cloud.store.commits
    assert (await stand.ingest(batch(stretch(0)))).status_code == 200
    assert stand.cloud.store.commits == before + 2, "the batch, then the gateway's contact"
    assert count_frames(stand) == 1


async def test_batch_too_large_is_refused_while_it_streams(
    tmp_path: Path, identities: Identities
) -> None:
    server = identities.make(IdentityKind.SERVER, "server.cloud").directory
    own = GatewaysSection(identity=server, body_bytes=65_536)
    with standing(tmp_path, identities, gateways=own) as stand:
        problem(await stand.ingest(b"x" * 65_537), 413)
        sent = 0

        async def long() -> Any:
            nonlocal sent
            while sent < 1000:  # one that is not refused must end, too
                sent += 1
                yield b"x" * 4096

        async with stand.ingest_client() as client:
            answer = await client.post(
                "/api/v1/ingest",
                content=long(),
            )
        problem(answer, 413)
        assert sent <= 18


@pytest.mark.parametrize(
    "body", [b"", b"\xff", cbor2.dumps({}), cbor2.dumps([0] * 10_001), gzip.compress(b"x", mtime=0)]
)
async def test_body_that_is_no_batch_is_refused(stand: Stand, body: bytes) -> None:
    problem(await stand.ingest(body), 422)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(st.binary(max_size=200), st.binary(max_size=200).map(lambda b: b"\x82" + b)))
def test_any_bytes_are_a_batch_or_refused(body: bytes) -> None:
    try:
        items = read_batch(body)
    except MalformedBatchError:
        return
    assert all((item.message is None) == (item.reason is not None) for item in items)


async def test_odd_items_are_rejected_one_by_one(stand: Stand) -> None:
    good = [NODE, stretch(0).encode()]
    odd = [[], [NODE], 5, [NODE, "text"], [b"x", b"y"], [NODE, b"x" * 70_000], None, good]
    answer = await stand.ingest(cbor2.dumps(odd))
    results = [item["result"] for item in answer.json()["items"]]
    assert results == ["rejected"] * 7 + ["stored"]


async def test_message_that_fails_in_the_store_is_rejected_alone(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(node: str, said: Statements, *rest: Any) -> Any:
        if said.peaks:
            raise ZeroDivisionError(f"of {node}: {said.peaks[0].height}")
        return statement_rows(node, said, *rest)

    monkeypatch.setattr("eskin_cloud.store.write.ingest.statement_rows", breaks)
    said = stretch(0), peak(1), stretch(2), gap(3)
    for outcome in ("stored", "duplicate"):
        items = (await stand.ingest(batch(*said))).json()["items"]
        assert [item["result"] for item in items] == [outcome, "rejected", outcome, outcome]
        assert items[1]["reason"].startswith("it cannot be stored: ZeroDivisionError")
    monkeypatch.undo()
    assert (await stand.ingest(batch(stretch(4)))).json()["items"][0]["result"] == "stored"
    assert count_frames(stand) == 3
    with stand.cloud.store.read() as connection:
        letters = connection.execute(select(dead_letters.c.data)).scalars().all()
    assert letters == [b""]  # it is not known which step failed: it may be biometric


async def test_status_that_fails_in_the_store_is_kept(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("eskin_cloud.store.write.ingest.status_row", breaks)
    answer = await stand.ingest(batch(status(0)))
    assert answer.json()["items"][0]["result"] == "rejected"
    with stand.cloud.store.read() as connection:
        letters = connection.execute(select(dead_letters.c.data)).scalars().all()
    assert letters == [status(0).encode()]


async def test_message_that_fails_in_the_parser_is_rejected_alone(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    bad = stretch(1).encode()

    def breaks(data: bytes) -> EncodedFrame:
        if data == bad:
            raise OverflowError("a number that is not expected")
        return decode(data)

    decode = EncodedFrame.decode
    monkeypatch.setattr(EncodedFrame, "decode", breaks)
    items = (await stand.ingest(batch(stretch(0), stretch(1), stretch(2)))).json()["items"]
    assert [item["result"] for item in items] == ["stored", "rejected", "stored"]
    assert items[1]["reason"].startswith("it broke what reads it: OverflowError")
    assert count_frames(stand) == 2


async def test_lack_of_memory_rejects_no_message(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(_: bytes) -> EncodedFrame:
        raise MemoryError

    monkeypatch.setattr(EncodedFrame, "decode", breaks)
    assert (await stand.ingest(batch(stretch(0)))).status_code == 500
    monkeypatch.undo()
    items = (await stand.ingest(batch(stretch(0)))).json()["items"]
    assert [item["result"] for item in items] == ["stored"]


def take_few_values(connection: Connection) -> None:
    """Be as strict as any build of SQLite; PostgreSQL is so by itself."""
    own = connection.connection.driver_connection
    if isinstance(own, sqlite3.Connection):
        own.setlimit(sqlite3.SQLITE_LIMIT_VARIABLE_NUMBER, 32_766)


@pytest.mark.nightly
async def test_batch_with_more_keys_than_a_statement_takes_is_stored(stand: Stand) -> None:
    stand.cloud.store.write(take_few_values).result()
    said = [[f"hand-{n % 4}", stretch(n, boot=1 + n).encode()] for n in range(10_000)]
    answer = await stand.ingest(cbor2.dumps(said))
    assert [item["result"] for item in answer.json()["items"]] == ["stored"] * 10_000


@pytest.mark.parametrize("first", [-(2**63) + 1, -(2**62), 0])
async def test_frame_of_any_time_before_now_is_stored(stand: Stand, first: int) -> None:
    ancient = stretch(0, time=(first, START)), stretch(1, time=(first, first))
    items = (await stand.ingest(batch(*ancient))).json()["items"]
    assert [item["result"] for item in items] == ["stored"] * 2
    node = (await stand.get(f"/api/v1/nodes/{NODE}")).json()
    assert node["lag"]["hi_ns"] == min(stand.clock() - first, MOST_LAG)


@pytest.mark.parametrize("place", ["sqlite"], indirect=True)
async def test_readiness_shows_a_fault_that_lasts(stand: Stand) -> None:
    stand.present(batch(stretch(0)))
    stand.cloud.store.write(
        lambda c: c.execute(text("ALTER TABLE feed RENAME TO renamed_feed")).rowcount
    ).result(120)
    problem(await stand.ingest(batch(stretch(0))), 503)
    with pytest.raises(StoreError):
        stand.cloud.store.write(lambda _: None).result(120)
    problem(await stand.get("/readyz"), 503)
    assert (await stand.get("/healthz")).json() == {"status": "ok"}
