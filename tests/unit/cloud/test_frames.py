"""Frames and statements in the store: rows, events, totals, and what is missing to read them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.store.damage import DamagedRowError, FrameHeader, require_intact
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.frame_row import fit_frame
from eskin_cloud.store.read.patch_runs import read_runs
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import descriptions, frames, pages
from eskin_cloud.store.schema.tables import dead_letters, events, lost_ranges, nodes, sequences
from eskin_cloud.store.write.ingest import DUPLICATE, REJECTED, STORED, UNKNOWN_LAYOUT
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import select, update

from eskin.errors import MessageError
from eskin.wire.frames import (
    DescribedLayout,
    EncodedFrame,
    Frame,
    Grid,
    PatchSamples,
)
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import numbers, put
from tests.unit.cloud.messages import NODE, START, skin_of, stretch
from tests.unit.cloud.skins import (
    HAND,
    PATCHES,
    describe,
    frame,
    layout,
    patch,
    samples,
    statements,
)

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult
    from sqlalchemy import Table


def results(outcome: IngestResult) -> list[str]:
    return [receipt.result for receipt in outcome.results]


def rows(store: Store, table: Table) -> list[dict[str, Any]]:
    with store.read() as connection:
        query = select(table).order_by(*table.primary_key.columns)
        return [dict(row) for row in connection.execute(query).mappings()]


def test_frame_is_kept_byte_for_byte(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    said = frame(0, at=SECOND)
    assert results(put(store, said)) == [STORED]
    (row,) = rows(store, frames)
    require_intact(FrameHeader, row)
    assert row["data"] == said.encode()
    assert row["samples"] == sum(values.inf.size for values in said.values)


@pytest.mark.parametrize("compacted", [False, True])
def test_frame_of_a_node_that_runs_for_years_is_read_as_it_was(
    store: Store, *, compacted: bool
) -> None:
    said = replace(stretch(0), ticks=400 * 86_400 * 10**9)
    assert results(put(store, said)) == [STORED]
    if compacted:
        compact_all(store)
    with store.read() as connection:
        assert bool(rows(store, frames)) is not compacted
        patch_id = skin_of()[1].patch_id
        (run,) = read_runs(connection, NODE, patch_id, Window(START, START + SECOND))
    assert (run.ticks, run.t) == (said.ticks, START)


def test_clock_that_does_not_fit_into_64_bit_is_refused(store: Store) -> None:
    late = replace(stretch(0, [1.0, 2.0], [3.0, 4.0]), ticks=2**63 - 1)
    early = replace(stretch(1), ticks=2**63 - 1, time=(-START, -START))
    assert results(put(store, late, early)) == [REJECTED] * 2


def test_row_states_when_first_and_last_sample_were_taken(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    put(store, frame(0), frame(1, page=1, at=7))
    first, second = rows(store, frames)
    middle = START + 2000
    # Patch 0 begins first and ends last: five rows of 4 ms, its last column 4 us later.
    assert (first["t"], first["t_end"]) == (middle + 1000, middle + 1000 + 16_000_000 + 4000)
    assert (first["t_lo"], first["t_hi"], first["error"]) == (START, START + 4000, 2000)
    assert (second["t"], second["t_end"]) == (middle + 7 + 1000, middle + 7 + 16_001_000)
    assert [row["samples"] for row in (first, second)] == [16, 10]


def test_node_and_page_state_totals_layout_and_lag(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    said = [frame(0), frame(2, at=SECOND), frame(1, page=1)]
    outcome = put(store, *said)
    of_first, of_second = rows(store, pages)
    assert (of_first["frames"], of_first["samples"]) == (2, 32)
    assert of_first["bytes"] == len(said[0].encode()) + len(said[1].encode())
    assert of_first["t_last"] - of_first["t_first"] == SECOND + 16_004_000
    assert (of_second["page"], of_second["frames"], of_second["longest"]) == (1, 1, 16_000_000)
    (node,) = rows(store, nodes)
    assert node["layout"] == HAND.content_hash
    assert (node["boot"], node["sequence"]) == (1, 2)
    ended = START + 1000 + 16_000_000
    assert outcome.lag == (store.clock() - ended - 4000, store.clock() - ended)
    assert (node["lag_lo"], node["lag_hi"]) == outcome.lag


def test_message_of_an_unknown_layout_names_what_is_missing_and_holds_up_no_other(
    store: Store,
) -> None:
    (refused,) = put(store, frame(0)).results
    assert (refused.result, refused.want[0]) == (UNKNOWN_LAYOUT, HAND.content_hash)
    describe(store, HAND, PATCHES[0])
    of_both = put(store, frame(0), statements(2)).results
    missing = tuple(each.content_hash for each in PATCHES[1:])
    assert [each.want for each in of_both] == [missing] * 2
    assert not rows(store, frames)
    assert not rows(store, events)
    assert not rows(store, sequences)
    assert not rows(store, nodes)
    describe(store, *PATCHES)
    unknown = layout(PATCHES[::-1], (3,))
    outcome = put(store, frame(0, of=unknown), frame(0), statements(2, of=unknown), frame(1))
    assert results(outcome) == [UNKNOWN_LAYOUT, STORED, UNKNOWN_LAYOUT, STORED]


def test_layout_of_another_node_does_not_serve(store: Store) -> None:
    describe(store, HAND, *PATCHES, node="other")
    assert results(put(store, frame(0), node="other")) == [STORED]
    (refused,) = put(store, frame(0)).results
    assert set(refused.want) == {HAND.content_hash, *HAND.patches}


def test_duplicate_and_conflicting_frames(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    assert results(put(store, frame(0), frame(0), frame(0, seed=1))) == [
        STORED,
        DUPLICATE,
        REJECTED,
    ]
    store.clear_caches()
    assert results(put(store, frame(0, seed=2), frame(0), statements(0))) == [
        REJECTED,
        DUPLICATE,
        REJECTED,
    ]
    (kept,) = rows(store, frames)
    assert kept["data"] == frame(0).encode()
    kept_aside = {row["data"] for row in rows(store, dead_letters)}
    others = (frame(0, seed=1), frame(0, seed=2), statements(0))
    assert kept_aside == {each.encode() for each in others}
    assert [row["kind"] for row in rows(store, events)] == ["conflict"] * 3


def test_statements_become_events_with_cursors_of_their_own(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    outcome = put(store, frame(0), statements(1))
    assert results(outcome) == [STORED, STORED]
    peak, gap = rows(store, events)
    assert (peak["kind"], peak["channel"], peak["unit"]) == ("peak", "palm-1.pressure", "Pa")
    assert (peak["data"], gap["data"]) == (statements(1).encode(), None)
    assert gap["detail"] == "flash full: 7 messages and 1750 samples lost; patches palm, tip"
    assert [(row["boot"], row["first"], row["last"]) for row in rows(store, lost_ranges)] == [
        (0, 3, 9)
    ]
    of_frame, *of_events = outcome.entries
    assert (of_frame.frame, of_frame.layout) == (frame(0).encode(), HAND.content_hash)
    assert of_frame.channel is None
    assert of_frame.size == len(frame(0).encode())
    assert [entry.event for entry in of_events] == [
        {name: value for name, value in row.items() if name not in {"row_digest", "slot"}}
        for row in (peak, gap)
    ]
    assert numbers(entry.cursor for entry in outcome.entries) == [1, 2, 3]


@pytest.mark.parametrize("column", ["data", "t", "layout", "samples", "head"])
def test_damaged_row_is_found(store: Store, column: str) -> None:
    describe(store, HAND, *PATCHES)
    put(store, frame(0))
    (row,) = rows(store, frames)
    value = row[column]
    other = bytes([value[0] ^ 1, *value[1:]]) if isinstance(value, bytes) else value ^ 1
    store.write_and_wait(lambda connection: connection.execute(update(frames), {column: other}))
    (damaged,) = rows(store, frames)
    with pytest.raises(DamagedRowError):
        require_intact(FrameHeader, damaged)


def test_damaged_description_is_asked_for_again_and_replaced(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    spoiled = PATCHES[0].content_hash
    d = descriptions.c
    store.write_and_wait(
        lambda connection: connection.execute(
            update(descriptions).where(d.hash == spoiled).values(data=b"\xa0")
        )
    )
    (refused,) = put(store, frame(0)).results
    assert refused.want == (spoiled,)
    assert describe(store, PATCHES[0], PATCHES[1]) == [("stored", None), ("duplicate", None)]
    assert results(put(store, frame(0))) == [STORED]


def test_layout_may_change_in_mid_boot(store: Store) -> None:
    other = layout((*PATCHES, patch("thumb", 4)), (2, 1, 1))
    describe(store, HAND, *PATCHES, other, patch("thumb", 4))
    said = frame(0), frame(1, of=other), statements(2, of=other), frame(3, of=other, page=1)
    assert results(put(store, *said)) == [STORED] * 4
    (node,) = rows(store, nodes)
    assert node["layout"] == other.content_hash
    assert results(put(store, frame(0))) == [DUPLICATE]
    (node,) = rows(store, nodes)
    assert node["layout"] == other.content_hash, "a repeated frame is not the latest"
    assert len(rows(store, pages)) == 3
    with store.read() as connection:
        assert find_layout(connection, NODE, other.content_hash).places["thumb-2.pressure"] == (
            3,
            2,
        )


@given(st.data())
@settings(deadline=None, max_examples=60)
def test_first_and_last_sample_are_those_of_all_cells(data: st.DataObject) -> None:
    """Skews, delays and strides included, against every cell of every patch."""
    patches, packed, grids, instants = [], [], [], []
    for number in range(data.draw(st.integers(1, 3))):
        columns = data.draw(st.integers(1, 4))
        skew = tuple(data.draw(st.lists(st.integers(0, 9), min_size=columns, max_size=columns)))
        each = patch(f"p{number}", columns, skew=skew if any(skew) else ())
        strides = bytes(data.draw(st.lists(st.integers(0, 2), min_size=columns, max_size=columns)))
        numbers = st.integers(0, 50)
        grid = Grid(data.draw(numbers), 1 + data.draw(numbers), data.draw(numbers), 5, 0.5)
        if grid not in grids:
            grids.append(grid)
        patches.append(each)
        packed.append(
            PatchSamples.pack(
                samples(5, columns),
                64.0,
                patch=number,
                grid=grids.index(grid),
                first_row=grid.first_row,
                strides=strides if any(strides) else b"",
            )
        )
        instants += [
            grid.delay + row * grid.period + skew[column]
            for row in range(5)
            for column in range(columns)
            if (grid.first_row + row) % (1 << strides[column]) == 0
        ]
    of = layout(patches, (len(patches),))
    try:
        said = Frame(
            Position(1, 0), of.content_hash, 0, 0, (START, START), tuple(grids), tuple(packed)
        )
    except MessageError:  # a patch without any sample
        return
    encoded = said.encode()
    fitting = fit_frame(EncodedFrame.decode(encoded), DescribedLayout.of(of, patches))
    assert (fitting.first, fitting.last) == (min(instants), max(instants))
    assert fitting.samples == len(instants)
