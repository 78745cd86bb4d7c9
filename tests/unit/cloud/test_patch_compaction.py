"""Compaction of frames loses and changes no sample, whatever comes late or breaks off."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest
from eskin_cloud.store import compaction
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.damage import PatchRowHeader, is_intact_row
from eskin_cloud.store.disk_usage import measure_disk
from eskin_cloud.store.patch_rows import MOST_CELLS, decode_runs
from eskin_cloud.store.schema.frame_tables import frames, pages, patch_rows, patches
from eskin_cloud.store.write.ingest import DUPLICATE, STORED
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, event, func, select, update

from eskin.errors import StoreError
from eskin.wire.frames import Frame, Grid, PatchSamples
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame, layout, patch, samples

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.store import Store
    from eskin_cloud.store.location import StoreLocation

    from tests.unit.cloud.clouds import Clock

STRETCH = SECOND // 10
ALL = Due(2**62, -(2**62))
"""Frames of any age; too few for a row stay."""
REST = Due(2**62, 2**62)
"""Frames of any age and number."""


class Sampled(NamedTuple):
    """A patch in a frame, as its bytes."""

    patch: str
    boot: int
    sequence: int
    ticks: int
    t: int
    error: int
    dt: int
    first_row: int
    strides: bytes
    epoch: int
    unshared: tuple[int, ...]
    coverage: float
    lo: bytes
    hi: bytes


def of_frame(said: Frame) -> list[Sampled]:
    """What a frame states of each patch, read from the message alone."""
    found = []
    for each, values in zip(said.patches, said.values, strict=True):
        grid = said.grids[each.grid]
        found.append(
            Sampled(
                PATCHES[each.patch].patch_id, *said.position, said.ticks + grid.delay,
                sum(said.time) // 2 + grid.delay, -(-(said.time[1] - said.time[0]) // 2),
                grid.period, grid.first_row, each.strides, each.epoch, each.unshared,
                grid.coverage, values.inf.tobytes(), values.sup.tobytes(),
            )
        )  # fmt: skip
    return found


def stored(store: Store) -> list[Sampled]:
    """All that the store has of frames, compacted or not."""
    found = []
    with store.read() as connection:
        for (data,) in connection.execute(select(frames.c.data)):
            found += of_frame(Frame.decode(data))
        for row in connection.execute(select(patch_rows)).mappings():
            assert is_intact_row(PatchRowHeader, row)
            for run in decode_runs(row["data"]):
                rest = run[1:-2]
                arrays = (np.ascontiguousarray(side).tobytes() for side in run[-2:])
                found.append(Sampled(row["patch"], *rest, *arrays))
    return sorted(found)


def require_totals(store: Store) -> None:
    """Check the totals of pages and patches against their rows."""
    with store.read() as connection:
        f, p = frames.c, patch_rows.c
        query = select(f.layout, f.page, func.count(), func.sum(f.samples), func.min(f.t))
        counted = {
            (layout, page): rest
            for layout, page, *rest in connection.execute(query.group_by(f.layout, f.page))
        }
        for row in connection.execute(select(pages)).mappings():
            found = counted.get((row["layout"], row["page"]), [0, 0, None])
            assert [row["frames"], row["samples"], row["t_first"]] == found
        size = func.sum(func.length(p.data))
        query = select(
            p.patch, func.count(), func.sum(p.samples), size, func.min(p.t), func.max(p.t_end)
        )
        of_patches = {patch: rest for patch, *rest in connection.execute(query.group_by(p.patch))}
        names = ("rows", "samples", "bytes", "t_first", "t_last")
        for row in connection.execute(select(patches)).mappings():
            expected = of_patches.get(row["patch"], [0, 0, 0, None, None])
            assert [row[name] for name in names] == expected
            assert row["longest"] >= 0


def compact_all(store: Store, due: Due = REST) -> int:
    """Compact until there is nothing more; gives how many steps it took."""
    steps = 0
    for page in find_compactable_frames(store, due):
        while compact_frames(store, page, due):
            steps += 1
    return steps


def count(store: Store, table: Any) -> int:
    with store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(table)).scalar_one())


def said(k: int, **rest: Any) -> Frame:
    return frame(k, at=k * STRETCH, seed=k, **rest)


def test_rows_hold_what_the_frames_held(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k, page=k % 2) for k in range(300)))
    before = stored(store)
    assert before == sorted(each for k in range(300) for each in of_frame(said(k, page=k % 2)))
    assert compact_all(store) > 0
    assert stored(store) == before
    assert count(store, frames) == 0
    require_totals(store)
    with store.read() as connection:
        assert sum(connection.execute(select(patch_rows.c.frames)).scalars()) == len(before)


def test_few_samples_in_many_cells_are_compacted(store: Store) -> None:
    wide = patch("wide", 64)
    described = layout((wide,), (1,))
    describe(store, described, wide)
    grid, strides = Grid(0, SECOND // 1000, 0, 1000, 1.0), bytes([16]) * 64
    expected = []
    for k in range(MOST_CELLS // 64_000 + 20):
        values = samples(1000, 64, seed=k)
        packed = PatchSamples.pack(values, 64.0, patch=0, grid=0, first_row=0, strides=strides)
        first = START + k * SECOND
        put(
            store,
            Frame(
                Position(1, k), described.content_hash, 0, k * SECOND, (first, first), (grid,),
                (packed,),
            ),
        )  # fmt: skip
        expected.append(values[0])
    compact_all(store)
    assert count(store, frames) == 0
    require_totals(store)
    with store.read() as connection:
        rows = connection.execute(select(patch_rows.c.data)).scalars().all()
    runs = sorted((run for row in rows for run in decode_runs(row)), key=lambda run: run.t)
    assert len(rows) > 1
    assert len(runs) == len(expected)
    for run, each in zip(runs, expected, strict=True):
        assert np.all((run.lo[0] <= each.inf) & (each.sup <= run.hi[0]))


def test_rows_are_ten_seconds_long_and_the_rest_waits(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    said_all = [frame(k, at=k * SECOND, seed=k) for k in range(1500)]
    put(store, *said_all)
    compact_all(store, ALL)
    with store.read() as connection:
        query = select(patch_rows.c.patch, patch_rows.c.t, patch_rows.c.t_end)
        rows = connection.execute(query).all()
    assert rows
    assert all(end - first >= 10 * SECOND for _, first, end in rows)
    assert 0 < count(store, frames) < 1500
    require_totals(store)
    assert stored(store) == sorted(each for one in said_all for each in of_frame(one))


def test_only_old_frames_are_compacted(store: Store, clock: Clock) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(200)))
    clock.turn(120)
    put(store, *(said(k) for k in range(200, 210)))
    assert find_compactable_frames(store, Due.after(clock.now - 2 * SECOND, 120 * SECOND)) == []
    due = Due(clock.now - 60 * SECOND, clock.now - 60 * SECOND)
    compact_all(store, due)
    assert count(store, frames) == 10
    require_totals(store)


def test_disk_use_counts_the_samples_of_frames_and_rows(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(150)))
    assert measure_disk(store).samples == 150 * 16
    compact_all(store, ALL)
    assert measure_disk(store).samples == 150 * 16


def test_copies_of_compacted_frames_are_duplicates(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(200)))
    compact_all(store)
    before = stored(store)
    outcome = put(store, *(said(k) for k in range(200)))
    assert Counter(each.result for each in outcome.results) == {DUPLICATE: 200}
    assert stored(store) == before


def test_late_frames_become_rows_of_their_own(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(300) if k not in {7, 8, 150}))
    compact_all(store)
    whole = count(store, patch_rows)
    put(store, said(8), said(150), said(7))
    compact_all(store)
    assert count(store, frames) == 0
    assert count(store, patch_rows) > whole
    assert stored(store) == sorted(each for k in range(300) for each in of_frame(said(k)))
    require_totals(store)


def test_damaged_frames_stay_and_hold_up_no_others(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(300)))

    def damage(connection: Any) -> None:
        for sequence in (0, 50, 299):
            here = frames.c.sequence == sequence
            data = bytearray(connection.execute(select(frames.c.data).where(here)).scalar_one())
            data[-3] ^= 1
            connection.execute(update(frames).where(here).values(data=bytes(data)))

    store.write(damage).result(120)
    compact_all(store)
    compact_all(store)
    with store.read() as connection:
        left = connection.execute(select(frames.c.sequence).order_by(frames.c.sequence)).scalars()
        assert list(left) == [0, 50, 299]
    require_totals(store)
    compacted = [each for each in stored_rows(store) if each.patch == "palm"]
    assert len(compacted) == 297


def stored_rows(store: Store) -> list[Sampled]:
    found = []
    with store.read() as connection:
        for row in connection.execute(select(patch_rows)).mappings():
            for run in decode_runs(row["data"]):
                arrays = (np.ascontiguousarray(side).tobytes() for side in run[-2:])
                found.append(Sampled(row["patch"], *run[1:-2], *arrays))
    return sorted(found)


def test_frame_that_comes_meanwhile_is_compacted_later(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(1, 200)))
    replace = compaction._replace
    brought: list[int] = []

    def and_another(connection: Any, *rest: Any, **more: Any) -> bool:
        if not brought:
            brought.append(0)
            waiting.append(store.write_node(NODE, lambda *_: None))
        return replace(connection, *rest, **more)

    waiting: list[Any] = []
    (page,) = find_compactable_frames(store, REST)
    with store.read() as connection:
        made = compaction._compact(connection, page, REST)
    assert made is not None
    put(store, said(0))
    monkeypatch.setattr(compaction, "_replace", and_another)
    store.write_node(NODE, lambda c, cache: compaction._replace(c, cache, made)).result(120)
    assert count(store, frames) == 1
    compact_all(store)
    assert count(store, frames) == 0
    assert stored(store) == sorted(each for k in range(200) for each in of_frame(said(k)))
    require_totals(store)


@contextmanager
def failing_at(number: int) -> Iterator[list[str]]:
    """Have the so-manieth statement of the writer that changes something fail."""
    seen: list[str] = []

    def look(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        word = statement.split(maxsplit=1)[0]
        if word in {"INSERT", "UPDATE", "DELETE", "COPY"}:
            seen.append(statement)
            if len(seen) == number:
                raise StoreError("the disk is full")

    event.listen(Engine, "before_cursor_execute", look)
    try:
        yield seen
    finally:
        event.remove(Engine, "before_cursor_execute", look)


def test_fault_at_any_statement_leaves_every_sample_once(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(150)))
    before = stored(store)
    (page,) = find_compactable_frames(store, REST)
    number, done = 0, False
    while not done:
        number += 1
        with failing_at(number) as seen:
            try:
                compact_frames(store, page, REST)
            except StoreError:
                pass
            else:
                done = len(seen) < number
        assert stored(store) == before
        require_totals(store)
    assert number > 4
    compact_all(store)
    assert count(store, frames) == 0


KILLED = """
import os, sys
from pathlib import Path
from sqlalchemy import Engine, event, make_url
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames

place, number = sys.argv[1], int(sys.argv[2])
store = Store(make_url(place) if "://" in place else Path(place))
due = Due(2**62, 2**62)
found = find_compactable_frames(store, due)
seen = 0

def look(*_):
    global seen
    seen += 1
    if seen == number:
        os._exit(9)

event.listen(Engine, "before_cursor_execute", look)
event.listen(Engine, "commit", look)
for page in found:
    while compact_frames(store, page, due):
        pass
os._exit(0)
"""


@pytest.mark.parametrize(
    "stride",
    [13, pytest.param(5, marks=pytest.mark.nightly)],
)
def test_kill_between_any_statements_leaves_every_sample_once(
    store: Store, place: StoreLocation, stride: int
) -> None:
    describe(store, HAND, *PATCHES)
    put(store, *(said(k) for k in range(150)))
    before = stored(store)
    shown = str(place) if isinstance(place, Path) else place.render_as_string(hide_password=False)
    status, number = 9, 0
    while status == 9:
        number += stride
        command = [sys.executable, "-c", KILLED, shown, str(number)]
        status = subprocess.run(command, check=False, env=dict(os.environ), timeout=120).returncode
        assert stored(store) == before
        require_totals(store)
    assert (status, number > 2 * stride) == (0, True)
    assert count(store, frames) == 0


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), st.integers(0, 400), st.integers(1, 150)),
        st.tuples(st.just("compact"), st.just(0), st.just(0)),
        st.tuples(st.just("rest"), st.just(0), st.just(0)),
    ),
    min_size=2,
    max_size=6,
)


@settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(steps=STEPS, boots=st.integers(1, 2))
def test_any_order_of_frames_and_compaction_keeps_all(
    store: Store, steps: list[tuple[str, int, int]], boots: int
) -> None:
    emptied(store)
    store.clear_caches()
    describe(store, HAND, *PATCHES)
    expected: dict[tuple[int, int], list[Sampled]] = {}
    for step, first, size in steps:
        if step != "put":
            compact_all(store, ALL if step == "compact" else REST)
        else:
            each = [said(k, boot=1 + k % boots, page=k % 3 % 2) for k in range(first, first + size)]
            outcome = put(store, *each)
            assert {receipt.result for receipt in outcome.results} <= {STORED, DUPLICATE}
            expected |= {one.position: of_frame(one) for one in each}
        require_totals(store)
        assert stored(store) == sorted(one for each in expected.values() for one in each)


def test_node_stays_the_only_one_that_is_compacted(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    describe(store, HAND, *PATCHES, node="other")
    put(store, *(said(k) for k in range(150)))
    put(store, *(said(k) for k in range(150)), node="other")
    for page in find_compactable_frames(store, REST):
        if page[1] == NODE:
            while compact_frames(store, page, REST):
                pass
    with store.read() as connection:
        assert set(connection.execute(select(frames.c.node)).scalars()) == {"other"}
        assert set(connection.execute(select(patch_rows.c.node)).scalars()) == {NODE}
        assert min(connection.execute(select(patch_rows.c.t)).scalars()) >= START
