"""Damaged rows are reported, left out, and never used.

On SQLite alone: a PostgreSQL server has checksums of its own.
"""

from __future__ import annotations

import csv
import io
import sqlite3
from contextlib import closing
from datetime import timedelta
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.access import Scope, create_token, revoke_token
from eskin_cloud.access.tokens import digest, token_id
from eskin_cloud.api.middleware.answer import DAMAGED
from eskin_cloud.jobs.integrity import look_at
from eskin_cloud.store import Store
from eskin_cloud.store.integrity import LARGE_TABLES, find_corruption
from eskin_cloud.store.row_digests import CHECKED_TABLES, ROW_DIGEST, find_damaged
from eskin_cloud.store.schema.frame_tables import frames, pages
from eskin_cloud.store.schema.tables import metadata, nodes, sequences
from eskin_cloud.store.write.ingest import DUPLICATE
from sqlalchemy import select

from eskin.errors import StoreError
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.everything import fill
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, gap, peak, status, stretch
from tests.unit.cloud.orders import order
from tests.unit.cloud.sealing import Site, sealing

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


def damage(path: Path, statement: str, *values: object) -> None:
    """Change the file as a worn disk does: no trigger updates the digest."""
    with closing(sqlite3.connect(path)) as db, db:
        triggers = db.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'")
        kept = triggers.fetchall()
        for name, _ in kept:
            db.execute(f"DROP TRIGGER {name}")
        assert db.execute(statement, values).rowcount
        for _, made in kept:
            db.execute(made)


def path_of(stand: Stand) -> Path:
    place = stand.cloud.settings.store.path
    assert place is not None
    return place


async def test_every_row_of_every_checked_table_has_its_digest(
    tmp_path: Path, identities: Identities, place: Path
) -> None:
    with sealing(tmp_path, identities, place=place) as stand:
        await fill(stand, Site(tmp_path))
        put(stand.cloud.store, stretch(700), status(701, boot=9), peak(702), gap(703))
        with stand.cloud.store.read() as connection:
            for table in CHECKED_TABLES:
                assert find_damaged(connection, table) == [], table.name
                written = connection.execute(select(table.c[ROW_DIGEST])).scalars().all()
                assert None not in written, table.name
            for table in metadata.sorted_tables:
                assert find_corruption(connection, table) is None


@pytest.mark.parametrize(
    "change", ["height_lo = 3", "t_lo = t_lo - 1", "kind = 'gap'", "channel = 'x'", "coverage = 1"]
)
async def test_damaged_event_is_left_out_and_reported(stand: Stand, change: str) -> None:
    put(stand.cloud.store, peak(1), gap(2))
    damage(path_of(stand), f"UPDATE events SET {change} WHERE sequence = 1")  # noqa: S608 - ours
    answer = await stand.get("/api/v1/events")
    assert [item["kind"] for item in answer.json()["items"]] == ["gap"]
    assert "events fingertip" in answer.headers[DAMAGED]


@pytest.mark.parametrize(
    "change",
    ["t = t + 500", "t_end = t_end + 1", "t_lo = t_lo + 1", "samples = 1", "error = 9",
     "page = 0, head = head + 1"],
)  # fmt: skip
async def test_frame_with_a_damaged_column_is_a_gap(stand: Stand, change: str) -> None:
    put(stand.cloud.store, *(stretch(k, [1.0, 2.0], [3.0, 4.0], time=(START + k * 2 * DT,) * 2)
                             for k in range(3)))  # fmt: skip
    damage(path_of(stand), f"UPDATE frames SET {change} WHERE sequence = 1")  # noqa: S608 - ours
    window = {"start": START - DT, "end": START + 9 * DT}
    path = f"/api/v1/series/{NODE}/{CHANNEL}"
    answer = await stand.get(path, points=100, **window)
    assert [lo for lo in answer.json()["lo"] if lo is not None] == [1.0, 2.0, 1.0, 2.0]
    assert "boot 1 sequence 1" in answer.headers[DAMAGED]
    segments = await stand.get(f"{path}/threshold", above=0.5, **window)
    assert "boot 1 sequence 1" in segments.headers[DAMAGED]


@pytest.mark.parametrize("compacted", [False, True])
async def test_export_leaves_a_damaged_row_out_and_reports_it(
    stand: Stand, *, compacted: bool
) -> None:
    store = stand.cloud.store
    put(store, *(stretch(k, time=(START + k * DT,) * 2) for k in range(64)))
    if compacted:
        compact_all(store)
    put(store, *(stretch(k, time=(START + k * DT,) * 2) for k in range(64, 70)))
    damage(path_of(stand), "UPDATE frames SET data = zeroblob(90) WHERE sequence = 66")
    answer = await stand.get("/api/v1/export", channel=f"{NODE}/{CHANNEL}")
    sequences_of = [int(row["sequence"]) for row in csv.DictReader(io.StringIO(answer.text))]
    assert sequences_of == [k for k in range(70) if k != 66]


@pytest.mark.parametrize(
    ("table", "change", "path"),
    [
        ("pages", "samples = 7", f"series/{NODE}/{CHANNEL}"),
        ("pages", "longest = 5", "export"),
        ("nodes", "faults = '{'", f"nodes/{NODE}"),
        ("states", "desired = '{'", f"nodes/{NODE}/state"),
        ("tokens", "scopes = 'reae'", "nodes"),
        ("tokens", "name = 'teso'", "nodes"),
    ],
)
async def test_damaged_row_is_named_in_the_problem(
    stand: Stand, table: str, change: str, path: str
) -> None:
    put(stand.cloud.store, status(0), stretch(1))
    await order(stand, {"name": "set", "arguments": {"rate": 500}})
    damage(path_of(stand), f"UPDATE {table} SET {change}")  # noqa: S608 - ours
    window: dict[str, object] = {"start": START, "end": START + DT} if "series" in path else {}
    if path == "export":
        window = {"channel": f"{NODE}/{CHANNEL}"}
    said = problem(await stand.get(f"/api/v1/{path}", **window), 503)
    assert table in said


async def test_damaged_rows_of_lists_are_left_out_and_reported(stand: Stand) -> None:
    put(stand.cloud.store, status(0), stretch(1))
    damage(path_of(stand), "UPDATE nodes SET gaps = 9")
    answer = await stand.get("/api/v1/nodes")
    assert answer.json()["items"] == []
    assert answer.headers[DAMAGED] == '"nodes fingertip"'


@pytest.mark.parametrize("change", ["expires = NULL", "revoked = NULL"])
async def test_damage_does_not_revive_a_token(stand: Stand, change: str) -> None:
    store = stand.cloud.store
    made = create_token(store, scopes=[Scope.READ], name="x", lifetime=timedelta(seconds=1))
    assert revoke_token(store, token_id(digest(made)))
    stand.clock.turn(9)
    damage(path_of(stand), f"UPDATE tokens SET {change} WHERE name = 'x'")  # noqa: S608 - ours
    async with stand.client(token=made) as client:
        assert (await client.get("/api/v1/nodes")).status_code == 503


def test_damaged_row_that_is_written_again_stays_damaged(store: Store, place: Path) -> None:
    put(store, stretch(1))
    damage(place, "UPDATE pages SET samples = 7")
    store.clear_caches()
    put(store, stretch(2, time=(START + DT,) * 2))
    with store.read() as connection:
        assert len(find_damaged(connection, pages)) == 1
        assert find_damaged(connection, nodes) == []
        assert len(connection.execute(select(frames)).all()) == 2


def test_sequences_under_a_name_that_is_no_text_are_restored(store: Store, place: Path) -> None:
    put(store, stretch(1), stretch(2, time=(START + DT,) * 2))
    damage(place, "UPDATE sequences SET node = CAST(x'e669' AS TEXT)")
    look_at(store, sequences)
    store.clear_caches()
    assert [each.result for each in put(store, stretch(1)).results] == [DUPLICATE]


async def test_counts_over_damaged_rows_are_unknown(stand: Stand) -> None:
    put(stand.cloud.store, stretch(1))
    damage(path_of(stand), "UPDATE pages SET node = 'fingertiq'")
    look_at(stand.cloud.store, pages)
    answer = await stand.get(f"/api/v1/nodes/{NODE}")
    assert answer.json()["channels"] is None
    assert "pages" in answer.headers[DAMAGED]
    (node,) = (await stand.get("/api/v1/nodes")).json()["items"]
    assert node["channels"] is None


@pytest.mark.parametrize("change", ["last = first - 1", "last = 7", "first = 0", "node = 'x'"])
async def test_damaged_ranges_are_restored_from_digests(stand: Stand, change: str) -> None:
    store = stand.cloud.store
    numbers = [1, 2, 5, 6]
    put(store, *(stretch(n, time=(START + n * DT,) * 2) for n in numbers))
    damage(path_of(stand), f"UPDATE sequences SET {change} WHERE first = 5")  # noqa: S608 - ours
    look_at(store, sequences)
    store.clear_caches()
    for number in (6, 2, 7):
        result = put(store, stretch(number, time=(START + number * DT,) * 2))
        assert [each.result for each in result.results] == (
            ["duplicate"] if number in numbers else ["stored"]
        )
    store.clear_caches()
    with store.read() as connection:
        s = sequences.c
        here = select(s.first, s.last).where(s.node == NODE).order_by(s.first)
        assert connection.execute(here).all() == [(1, 2), (5, 7)]


async def test_node_of_a_damaged_site_has_no_key(stand: Stand) -> None:
    put(stand.cloud.store, stretch(1), peak(2))
    damage(path_of(stand), "UPDATE node_sites SET site = 'site/main'")
    assert (await stand.get("/api/v1/events")).status_code == 200


def _page(path: Path, name: str) -> tuple[int, int]:
    """Where the first page of a tree begins and ends in the file."""
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        size = db.execute("PRAGMA page_size").fetchone()[0]
        query = "SELECT pageno FROM dbstat WHERE name = ? AND ncell > 0"
        (page,) = db.execute(query, (name,)).fetchone()
    return size * (page - 1), size * page


def _shift_index(path: Path, name: str) -> None:
    """Change the node's name in an index's page alone."""
    begin, end = _page(path, name)
    data = bytearray(path.read_bytes())
    at = data.index(NODE.encode(), begin)
    assert at < end
    data[at] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    "name", ["sqlite_autoindex_nodes_1", "frames_by_time", "sqlite_autoindex_sequences_1"]
)
def test_damaged_index_is_rebuilt(place: Path, name: str) -> None:
    with Store(place) as store:
        put(store, stretch(1))
    _shift_index(place, name)
    with Store(place) as store:
        for table in LARGE_TABLES:
            look_at(store, table)
        with store.read() as connection:
            assert all(
                find_corruption(connection, table) is None for table in metadata.sorted_tables
            )
            here = select(frames).where(frames.c.node == NODE)
            assert len(connection.execute(here).all()) == 1
            known = select(sequences.c.last).where(sequences.c.node == NODE)
            assert connection.execute(known).scalar_one() == 1
            assert connection.execute(select(nodes).where(nodes.c.node == NODE)).all()


def test_store_whose_index_cannot_be_rebuilt_is_not_read(place: Path) -> None:
    with Store(place) as store:
        put(store, stretch(1))
    at, _ = _page(place, "frames_by_time")
    data = bytearray(place.read_bytes())
    data[at] = 0xFF  # no kind of page
    place.write_bytes(data)
    with Store(place) as store:
        with pytest.raises(StoreError, match="restore a backup"):
            look_at(store, frames)
        with pytest.raises(StoreError, match="restore a backup"), store.read():
            pass


def test_store_with_two_rows_of_one_key_is_not_read(place: Path) -> None:
    with Store(place) as store:
        put(store, stretch(2), stretch(3, time=(START + DT,) * 2))
    begin, end = _page(place, "frames")
    data = bytearray(place.read_bytes())
    at = data.index(f"{NODE}\x02".encode(), begin, end) + len(NODE)  # boot 1 takes no byte
    data[at] = 3
    place.write_bytes(data)
    with Store(place) as store:
        with pytest.raises(StoreError, match="restore a backup"):
            look_at(store, frames)
        with pytest.raises(StoreError, match="restore a backup"), store.read():
            pass


def test_file_with_a_damaged_schema_is_rejected_with_a_remedy(place: Path) -> None:
    with Store(place) as store:
        put(store, stretch(1))
    with closing(sqlite3.connect(place)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    data = bytearray(place.read_bytes())
    data[data.index(b"CREATE TABLE versions") + 2] ^= 0x80
    place.write_bytes(data)
    with pytest.raises(StoreError, match="restore a backup"):
        Store(place)
