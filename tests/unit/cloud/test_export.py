"""Exports hold exactly the samples of a window, whatever the format, page by page or at once."""

from __future__ import annotations

import csv
import io
import tracemalloc
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from eskin_cloud.access import Principal
from eskin_cloud.api.dependencies import Access
from eskin_cloud.api.export import stream_file
from eskin_cloud.api.export_formats import WRITERS, write
from eskin_cloud.query.export import Export, ExportChannel
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.patch_runs import FRAMES_AT_ONCE
from eskin_cloud.store.read.window import Window

from eskin.runtime.http_server.problems import ProblemError
from eskin.wire.timestamp import parse_timestamp
from tests.unit.cloud.clouds import problem, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store import Store

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio

EXPORT = "/api/v1/export"
ONE, TWO = f"{NODE}/{CHANNEL}", f"{NODE}/t02.current"
ARROW = "application/vnd.apache.arrow.stream"
INF = float("inf")

Row = dict[str, Any]


@pytest.fixture
def filled(stand: Stand) -> Stand:
    """Two channels; frames that came out of order, overlap in time, and have holes."""
    for sequence, start in ((3, 40), (0, 0), (2, 15), (1, 10)):
        lo = np.arange(10.0) + start
        hi = lo + 0.125
        lo[3], hi[3] = -INF, INF  # missing
        lo[4], hi[5] = -INF, INF  # unbounded sides
        first = START + start * DT
        put(stand.cloud.store, stretch(sequence, lo, hi, time=(first - 4, first + 4)))
    more = stretch(4, [1.0, 2.0], [3.0, 4.0], channel="t02.current", unit="A", coverage=0.5)
    put(stand.cloud.store, more)
    return stand


def decoded(content: bytes, media: str) -> list[Row]:
    """An export's rows, alike for each format."""
    if media == "text/csv":
        return [_typed(row) for row in csv.DictReader(io.StringIO(content.decode()))]
    if media == ARROW:
        table = pa.ipc.open_stream(content).read_all()
    else:
        table = pa.parquet.read_table(io.BytesIO(content))
    for name in ("earliest", "latest"):
        place = table.schema.get_field_index(name)
        table = table.set_column(place, name, table[name].cast(pa.int64()))
    rows: list[Row] = table.to_pylist()
    return rows


def _typed(row: dict[str, str]) -> Row:
    kinds: dict[str, Any] = {"coverage": float, "dt": int, "boot": int, "sequence": int}
    kinds |= dict.fromkeys(("earliest", "latest"), parse_timestamp)
    kinds |= dict.fromkeys(("lo", "hi"), lambda text: float(text) if text else None)
    return {name: kinds.get(name, str)(text) for name, text in row.items()}


async def ask(stand: Stand, media: str, **params: Any) -> Any:
    async with stand.client() as client:
        return await client.get(EXPORT, params=params, headers={"Accept": media})


@pytest.mark.parametrize("media", list(WRITERS))
async def test_every_sample_is_there_with_the_instants_between_which_it_was_taken(
    filled: Stand, media: str
) -> None:
    answer = await ask(filled, media, channel=[ONE, TWO])
    assert answer.status_code == 200, answer.text
    rows = decoded(answer.content, media)
    assert len(rows) == 42 == int(answer.headers["eskin-samples"])
    assert "link" not in answer.headers
    first = rows[0]
    assert first == {
        "node": NODE, "channel": CHANNEL, "earliest": START - 4, "latest": START + 4,
        "lo": 0.0, "hi": 0.125, "unit": "F", "coverage": 1.0, "dt": DT, "boot": 1, "sequence": 0,
    }  # fmt: skip
    assert [row["sequence"] for row in rows[:40:10]] == [0, 1, 2, 3]
    assert (rows[3]["lo"], rows[3]["hi"]) == (None, None)
    assert (rows[4]["lo"], rows[5]["hi"]) == (-INF, INF)
    assert rows[-1]["channel"] == "t02.current"
    assert (rows[-1]["unit"], rows[-1]["coverage"], rows[-1]["hi"]) == ("A", 0.5, 4.0)


@pytest.mark.parametrize("media", list(WRITERS))
@pytest.mark.parametrize("limit", [1, 11, 41])
async def test_pages_put_together_are_the_whole_also_where_more_comes_meanwhile(
    filled: Stand, media: str, limit: int
) -> None:
    whole = decoded((await ask(filled, media, channel=[ONE, TWO])).content, media)
    pages: list[list[Row]] = []
    answer = await ask(filled, media, channel=[ONE, TWO], limit=limit)
    while True:
        assert answer.status_code == 200, answer.text
        pages.append(decoded(answer.content, media))
        if "link" not in answer.headers:
            break
        put(filled.cloud.store, stretch(100 + len(pages), time=(START + 10**15, START + 10**15)))
        target = urlsplit(answer.headers["link"].removeprefix("<").partition(">")[0])
        assert target.path == EXPORT
        answer = await ask(filled, media, **parse_qs(target.query))
    assert [row for page in pages for row in page] == whole
    assert all(len(page) >= min(limit, 2) for page in pages[:-1])
    assert all(len(page) < limit + 10 for page in pages)


async def test_window_is_cut_to_the_sample(filled: Stand) -> None:
    start, end = START + 12 * DT, START + 14 * DT
    rows = decoded(
        (await ask(filled, "text/csv", channel=ONE, start=start, end=end)).content, "text/csv"
    )
    assert [(row["lo"], row["hi"]) for row in rows] == [(12.0, 12.125), (None, None)]


async def test_empty_window_is_an_empty_file(filled: Stand) -> None:
    for media in WRITERS:
        answer = await ask(filled, media, channel=ONE, start=5, end=9)
        assert decoded(answer.content, media) == []


async def test_bad_queries_get_a_remedy(filled: Stand) -> None:
    refusals: dict[int, list[Row]] = {
        404: [{"channel": "palm/t01.capacitance"}, {"channel": f"{NODE}/t09.current"}],
        422: [
            {"start": 1},
            {"channel": "t01.capacitance"},
            {"channel": ONE, "start": 9, "end": 5},
            {"channel": ONE, "cursor": "whatever"},
            {"channel": ONE, "limit": 0},
            {"channel": ONE, "cursor": cursor(await ask(filled, "*/*", channel=[ONE, TWO, TWO],
                                                        limit=41))},
        ],
    }  # fmt: skip
    for status, questions in refusals.items():
        for question in questions:
            problem(await ask(filled, "text/csv", **question), status)
    detail = problem(await ask(filled, "application/json", channel=ONE), 406)
    assert all(media in detail for media in WRITERS)


def cursor(answer: Any) -> str:
    """The cursor of a page."""
    target = urlsplit(str(answer.headers["link"]).removeprefix("<").partition(">")[0])
    (found,) = parse_qs(target.query)["cursor"]
    return found


def export(store: Store) -> Export:
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
    return Export([ExportChannel(row, store.read)], Window(START, START + 2**60), None)


def pieces(store: Store, media: str) -> Iterator[bytes]:
    asked = export(store)
    return write(media, asked.read(None), asked.window)


@pytest.mark.nightly
@pytest.mark.parametrize("media", list(WRITERS))
def test_memory_does_not_grow_with_the_export(store: Store, media: str) -> None:
    def fill(first: int, last: int) -> None:
        values = np.random.default_rng(1).random(20)
        put(store, *(stretch(k, values, values + 1, time=(START + k * 10**9,) * 2)
                     for k in range(first, last)))  # fmt: skip

    def peak() -> tuple[int, int]:
        """Greatest bytes in use while it is written, and bytes written."""
        tracemalloc.start()
        pool = pa.default_memory_pool()
        most = count = 0
        for piece in pieces(store, media):
            count += len(piece)
            most = max(most, pool.bytes_allocated())
        own = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return own + most, count

    fill(0, 2 * FRAMES_AT_ONCE)
    short, little = peak()
    fill(2 * FRAMES_AT_ONCE, 8 * FRAMES_AT_ONCE)
    long, much = peak()
    assert much > 3.5 * little
    assert long < 1.3 * short


def test_revoked_token_ends_the_stream(filled: Stand) -> None:
    lasting = iter([True, False])
    access = Access(Principal("t", frozenset()), "", lambda: next(lasting))
    asked = replace(export(filled.cloud.store), sources=[*export(filled.cloud.store).sources] * 3)
    pieces = stream_file(asked, None, "text/csv", access, ExitStack())
    assert next(pieces)
    with pytest.raises(ProblemError, match="revoked"):
        next(pieces)
