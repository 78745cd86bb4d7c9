"""Digests: conflicts and damaged rows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.api.middleware.answer import DAMAGED
from eskin_cloud.live.feed import read_entries
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.hulls import read_ranges
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.rollup.samples import read_buckets
from eskin_cloud.store.feed_entry import FEED_START
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import frames, patch_rows, patch_tiles
from eskin_cloud.store.schema.tables import dead_letters, events
from sqlalchemy import and_, select, update

from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import batch, position, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, gap, peak, status, stretch

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.store import Store
    from sqlalchemy import Connection, Table

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
SAMPLES = 100


def said(number: int, *, level: float = 1.0) -> Any:
    start = START + number * SAMPLES * DT
    lo = [level + 0.01 * (k % 7) for k in range(SAMPLES)]
    hi = [each + 0.5 for each in lo]
    return stretch(number, lo, hi, time=(start, start))


def flip(
    store: Store, table: Table, *, bit: int | None = None, where: Any = True
) -> dict[str, Any]:
    """Flip a bit of one row's bytes, as a disk might; gives the row as it was."""

    def work(connection: Connection) -> dict[str, Any]:
        row = dict(connection.execute(select(table).where(where).limit(1)).mappings().one())
        data = bytearray(row["data"])
        at = 4 * len(data) if bit is None else bit
        data[at // 8] ^= 1 << (at % 8)
        keys = [column == row[column.name] for column in table.primary_key.columns]
        connection.execute(update(table).where(*keys).values(data=bytes(data)))
        return row

    return store.write(work).result(120)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (lambda: said(5), lambda: said(5, level=2.0)),
        (lambda: status(5), lambda: replace(status(5), uptime=7)),
        (lambda: status(5), lambda: said(5)),
        (lambda: peak(5), lambda: gap(5)),
        (lambda: gap(5), lambda: said(5)),
    ],
)
async def test_other_message_under_a_stored_number_is_a_dead_letter_and_an_event(
    stand: Stand, first: Callable[[], Any], second: Callable[[], Any]
) -> None:
    store = stand.cloud.store
    one, other = first(), second()
    assert (await stand.ingest(batch(one))).json()["items"][0]["result"] == "stored"
    before = stand.cloud.metrics.conflicts._value.get()
    assert (await stand.ingest(batch(one))).json()["items"][0]["result"] == "duplicate"
    answer = (await stand.ingest(batch(one, other, one))).json()["items"]
    assert [item["result"] for item in answer] == ["duplicate", "rejected", "duplicate"]
    with store.read() as connection:
        kept = connection.execute(select(dead_letters.c.data)).scalars().all()
        stated = connection.execute(select(events).where(events.c.kind == "conflict")).mappings()
        (event,) = stated.all()
    assert kept == [other.encode()]
    assert (event["node"], event["boot"], event["sequence"]) == (NODE, *one.position)
    assert stand.cloud.metrics.conflicts._value.get() == before + 1
    found = (await stand.get("/api/v1/events", kind="conflict")).json()["items"]
    assert [item["node"] for item in found] == [NODE]


def test_conflict_within_a_batch_is_detected(store: Store) -> None:
    outcome = put(store, said(1), said(1, level=2.0), said(1))
    assert [each.result for each in outcome.results] == ["stored", "rejected", "duplicate"]


def test_numbers_are_compared_in_any_order_and_after_a_restart(store: Store) -> None:
    numbers = np.random.default_rng(3).permutation(300).tolist()
    for at in range(0, 300, 7):
        put(store, *(said(number) for number in numbers[at : at + 7]))
    for _ in range(2):
        outcome = put(store, *(said(number) for number in range(300)))
        assert {each.result for each in outcome.results} == {"duplicate"}
        outcome = put(store, *(said(number, level=9.0) for number in range(300)), dead_letters=10)
        assert {each.result for each in outcome.results} == {"rejected"}
        store.clear_caches()


def test_conflict_with_compacted_and_removed_frames_is_detected(store: Store) -> None:
    put(store, *(said(number) for number in range(64)))
    compact_all(store)
    store.write(lambda c: c.execute(patch_rows.delete())).result(120)
    for number in (0, 13, 40, 63):
        outcome = put(store, said(number), said(number, level=2.0))
        assert [each.result for each in outcome.results] == ["duplicate", "rejected"]


@pytest.mark.parametrize("table", [frames, patch_rows], ids=["frames", "rows"])
async def test_damaged_row_is_a_gap_and_the_rest_is_served(stand: Stand, table: Table) -> None:
    store = stand.cloud.store
    half = 30 * SAMPLES
    put(store, *(said(number) for number in range(30)))
    if table is patch_rows:
        compact_all(store)
    put(store, *(said(number) for number in range(30, 60)))
    if table is patch_rows:
        compact_all(store)
    window = {"start": START, "end": START + 60 * SAMPLES * DT, "points": 10_000}
    whole = (await stand.get(SERIES, **window)).json()
    assert len(whole["lo"]) == 2 * half
    row = flip(store, table, where=table.c.t > START + 10 * SAMPLES * DT)
    answer = await stand.get(SERIES, **window)
    assert answer.status_code == 200
    found = answer.json()
    first, end = ((each - START) // DT for each in (row["t"], row["t_end"] + DT))
    assert end - first == row["samples"]
    gap_then_rest = [None, *whole["lo"][end:]] if end < 2 * half else []
    assert found["lo"] == [*whole["lo"][:first], *gap_then_rest]
    named = answer.headers[DAMAGED]
    assert NODE in named
    assert f"boot {row['boot']} sequence {row['sequence']}" in named or "t01-capacitance" in named
    assert "eskin_cloud_damaged_rows 0.0" not in stand.cloud.metrics.write().decode()


@pytest.mark.parametrize(
    "seed", [*range(10), *(pytest.param(seed, marks=pytest.mark.nightly) for seed in range(10, 40))]
)
def test_no_flipped_bit_is_ever_served(store: Store, seed: int) -> None:
    """After any bit flip of frames, rows and tiles, answers enclose the stored values."""
    put(store, *(said(number) for number in range(200)))
    if seed % 3:
        compact_all(store)
        build(store)
    chance = np.random.default_rng(seed)
    table = (frames, patch_rows, patch_tiles)[seed % 3]
    with store.read() as connection:
        rows = connection.execute(select(table)).mappings().all()
    row = rows[int(chance.integers(len(rows)))]
    here = [column == row[column.name] for column in table.primary_key.columns]
    bit = int(chance.integers(8 * len(row["data"])))

    flip(store, table, bit=bit, where=and_(*here))
    with store.read() as connection:
        channel = find_channel(connection, NODE, CHANNEL)
        grain, end = channel["grain"], START + 200 * SAMPLES * DT
        if grain is None:
            pieces = read_buckets(
                connection, channel, Window(START, end), Buckets(START, 2**30, 20)
            )
        else:
            within = START >> grain, (end >> grain) + 1
            pieces = read_ranges(connection, channel, grain, [within])
    lost = 0 if table is patch_tiles else row["samples"]
    assert 200 * SAMPLES - lost <= int(pieces.n.sum()) <= 200 * SAMPLES
    if not pieces.n.sum():
        return
    assert float(pieces.lo.min()) == pytest.approx(1.0, abs=1e-6)
    assert float(pieces.hi.max()) == pytest.approx(1.56, abs=1e-6)


async def test_export_and_live_backlog_leave_a_damaged_frame_out(stand: Stand) -> None:
    store = stand.cloud.store
    put(store, *(said(number) for number in range(8)))
    flip(store, frames, where=frames.c.sequence == 3)
    answer = await stand.get("/api/v1/export", channel=f"{NODE}/{CHANNEL}")
    assert answer.status_code == 200, answer.text
    with store.read() as connection:
        assert len(read_entries(connection, FEED_START.spans(position(10**9)))) == 7
