"""Tiles of patches say what the samples say, whatever comes late, is removed or breaks."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup import patch_tile_builder
from eskin_cloud.rollup.aggregates import Aggregates
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.column_aggregates import ColumnAggregates, pack, unpack
from eskin_cloud.rollup.hulls import read_ranges
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.rollup.patch_tiles import fold_chunks
from eskin_cloud.rollup.samples import read_buckets, read_samples
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP
from eskin_cloud.store.schema.frame_tables import patch_tiles, patches, stale_patch_chunks
from eskin_cloud.store.write.ingest import STORED
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select, update

from eskin.errors import MessageError, StoreError
from eskin.interval import Interval
from eskin.monitor import parse
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from tests.support.examples import examples
from tests.unit.cloud.brute_force import verdicts_of
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.query.stored_verdicts import StoredPiece
    from eskin_cloud.store.location import StoreLocation

    from eskin.monitor import Formula

TILED: Final = "tiled"
PLAIN: Final = "plain"
COLUMNS: Final = 3
GRAIN: Final = 4
"""Tiles of 16 ns, so that some frames fill chunks."""
START: Final = 1 << 60
SPAN: Final = 4000
FORMULAS: Final = (
    parse("x > 0.3"),
    parse("once[5ns,60ns] x > 1.2"),
    parse("rise(x > 0.3) and historically[0,20ns] x < 2"),
)
ALL: Final = Due(2**62, 2**62)
_BOUNDS = st.sampled_from([-math.inf, -2.0, -0.1, 0.0, 0.1, 0.3, 1.0, 1.5, 3.0, math.inf])
TAXELS: Final = tuple(f"t{column}" for column in range(COLUMNS))
SKEWED: Final = Patch("palm", "pressure", "Pa", TAXELS, 2.0**-3, skew=(0, 2, 5))
EVEN: Final = Patch("palm", "pressure", "Pa", TAXELS[::-1], 2.0**-3)
"""The same patch with its columns in another order."""
LAYOUTS: Final = {
    patch.content_hash: Layout((patch.content_hash,), (1,)) for patch in (SKEWED, EVEN)
}


@st.composite
def frames_of(draw: st.DrawFn, sequence: int) -> Frame:
    """A frame somewhere in the span; most lie on one grid."""
    rows = draw(st.integers(1, 20))
    shape = rows, COLUMNS
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    lo = random.integers(-40, 40, shape) / 8.0
    hi = lo + random.integers(0, 9, shape) / 8.0
    lo[random.random(shape) < draw(st.sampled_from((0.0, 0.2)))] = -np.inf
    hi[random.random(shape) < draw(st.sampled_from((0.0, 0.2)))] = np.inf
    first = START + draw(st.sampled_from([200 * sequence % SPAN, sequence * 131 % SPAN]))
    grid = Grid(
        delay=draw(st.integers(0, 3)),
        period=draw(st.sampled_from([10, 10, 10, 7, 40])),
        first_row=draw(st.integers(0, 9)),
        rows=rows,
        coverage=draw(st.sampled_from([1.0, 0.99])),
    )
    patch = draw(st.sampled_from([SKEWED, SKEWED, SKEWED, EVEN]))
    samples = PatchSamples.pack(
        Interval(lo, hi),
        patch.least_width,
        patch=0,
        grid=0,
        first_row=grid.first_row,
        strides=draw(st.sampled_from([b"", b"", b"\x00\x01\x02"])),
    )
    position = Position(1 + sequence % 2, sequence)
    time = first, first + draw(st.integers(0, 3))
    return Frame(
        position, LAYOUTS[patch.content_hash].content_hash, 0, 0, time, (grid,), (samples,)
    )


@st.composite
def histories(draw: st.DrawFn) -> list[list[Frame] | str]:
    """Frames in some batches, and what is done with them between."""
    steps: list[list[Frame] | str] = []
    sequence = 0
    for _ in range(draw(st.integers(2, 5))):
        batch = []
        for _ in range(draw(st.integers(1, 25))):
            batch.append(draw(frames_of(sequence)))
            sequence += 1
        steps.append(batch)
        steps += draw(st.lists(st.sampled_from(["compact", "build"]), max_size=3))
    return steps


def compact_all(store: Store) -> None:
    for page in find_compactable_frames(store, ALL):
        if page[1] == TILED:
            while compact_frames(store, page, ALL):
                pass
    unbuilt = update(patches).where(patches.c.built.is_(None)).values(grain=GRAIN)
    store.write(lambda connection: connection.execute(unbuilt)).result(120)


def start(store: Store) -> None:
    emptied(store)
    for node in (TILED, PLAIN):
        describe(store, SKEWED, EVEN, *LAYOUTS.values(), node=node)


def carry_out(store: Store, steps: Sequence[list[Frame] | str]) -> list[Frame]:
    """Do the steps; gives all frames."""
    start(store)
    brought = []
    for step in steps:
        if step == "compact":
            compact_all(store)
        elif step == "build":
            build(store)
        else:
            assert not isinstance(step, str)
            for node in (TILED, PLAIN):
                put(store, *step, node=node)
            brought += step
    return brought


def samples_of(brought: Sequence[Frame], taxel: str) -> list[tuple[int, float, float]]:
    """Time and bounds of a channel's samples, read from the messages alone."""
    found = []
    for frame in brought:
        patch = SKEWED if frame.layout == LAYOUTS[SKEWED.content_hash].content_hash else EVEN
        (record,), (values,), (grid,) = frame.patches, frame.values, frame.grids
        column = patch.taxels.index(taxel)
        step = 1 << record.strides[column] if record.strides else 1
        for row in range(grid.rows):
            if (grid.first_row + row) % step == 0:
                t = sum(frame.time) // 2 + grid.delay + row * grid.period
                t += patch.skew[column] if patch.skew else 0
                found.append((t, float(values.inf[row, column]), float(values.sup[row, column])))
    return found


def require_true(found: Aggregates, samples: list[tuple[int, float, float]], level: int) -> None:
    """Check aggregates of tiles against samples."""
    tiles: dict[int, list[tuple[int, float, float]]] = {}
    for sample in samples:
        tiles.setdefault(sample[0] >> level, []).append(sample)
    assert (found.first >> level).tolist() == sorted(tiles)
    for k, number in enumerate(sorted(tiles)):
        t, lo, hi = zip(*tiles[number], strict=True)
        assert (found.first[k], found.last[k], found.n[k]) == (min(t), max(t), len(t))
        assert (found.lo[k], found.hi[k]) == (min(lo), max(hi))
        for bound, side, sign in ((found.sum_lo[k], lo, 1), (found.sum_hi[k], hi, -1)):
            if math.isinf(sum(side)):
                assert bound == -sign * math.inf
            else:
                assert sign * Fraction(float(bound)) <= sign * sum(map(Fraction, side))
                assert abs(bound - sum(side)) <= len(t) * 2.0**-12


@settings(
    max_examples=examples(20),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow,
                           HealthCheck.data_too_large],
)  # fmt: skip
@given(steps=histories())
def test_tiles_are_those_of_the_samples(store: Store, steps: list[list[Frame] | str]) -> None:
    brought = carry_out(store, steps)
    with store.read() as connection:
        for taxel in TAXELS:
            channel = find_channel(connection, TILED, f"{taxel}.pressure")
            plain = find_channel(connection, PLAIN, f"{taxel}.pressure")
            samples = samples_of(brought, taxel)
            for level in range(GRAIN, GRAIN + 4 * STEP, STEP):
                if channel["grain"] is None:
                    continue
                first, end = START - 64 >> level, START + 2 * SPAN >> level
                found = read_ranges(connection, channel, level, [(first, end)])
                require_true(found, samples, level)
                buckets = Buckets(first << level, 1 << level, end - first)
                window = Window(first << level, end << level)
                other = read_buckets(connection, plain, window, buckets)
                for name in ("breaks", "dt", "error", "coverage"):
                    assert getattr(found, name).tolist() == getattr(other, name).tolist(), name
                some = [(first, first + 3), (first + 7, first + 9), (first + 20, end)]
                within = [(a << level, b << level) for a, b in some]
                found = read_ranges(connection, channel, level, some)
                mine = [each for each in samples if any(a <= each[0] < b for a, b in within)]
                require_true(found, mine, level)
                read = read_samples(connection, channel, *(Window(*each) for each in within))
                assert read.first.tolist() == sorted(t for t, _, _ in mine)


def without_coverage(piece: StoredPiece) -> StoredPiece:
    """Without its coverage: of the middles of the parts that it was joined of, which may differ."""
    return piece._replace(coverage=0.0)


@pytest.mark.filterwarnings("ignore:Generating overly large repr")
@settings(
    max_examples=examples(15),
    deadline=None,
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
    ],
)
@given(
    steps=histories(),
    begin=st.integers(-50, SPAN),
    span=st.integers(1, SPAN),
    points=st.sampled_from([1, 7, 1000]),
    samples=st.sampled_from([1, 8, 1000]),
    formula=st.sampled_from(FORMULAS),
)
def test_compaction_and_tiles_change_no_series_and_no_verdict(
    store: Store,
    steps: list[list[Frame] | str],
    begin: int,
    span: int,
    points: int,
    samples: int,
    formula: Formula,
) -> None:
    carry_out(store, steps)
    window = Window(START + begin, START + begin + span)
    with store.read() as connection:
        for taxel in TAXELS:
            channel = find_channel(connection, TILED, f"{taxel}.pressure")
            plain = find_channel(connection, PLAIN, f"{taxel}.pressure")
            one, other = (
                read_series(connection, each, window, points=points) for each in (channel, plain)
            )
            assert one.t.tolist() == other.t.tolist()
            assert (one.lo.tolist(), one.hi.tolist()) == (other.lo.tolist(), other.hi.tolist())
            assert one.coverage == other.coverage
            limits = {"points": points, "samples": samples}
            found = verdicts_of(connection, channel, window, formula, **limits)
            expected = verdicts_of(connection, plain, window, formula)
            assert [without_coverage(each) for each in found] == [
                without_coverage(each) for each in expected
            ]


def steady(first: int, count: int) -> list[Frame]:
    random = np.random.default_rng(first)
    found = []
    for k in range(first, first + count):
        lo = random.integers(-40, 40, (10, COLUMNS)) / 8.0
        grid = Grid(0, 10, 10 * k, 10, 1.0)
        samples = PatchSamples.pack(
            Interval(lo, lo + 1.0), SKEWED.least_width, patch=0, grid=0, first_row=10 * k
        )
        at = START + 100 * k
        name = LAYOUTS[SKEWED.content_hash].content_hash
        found.append(Frame(Position(1, k), name, 0, 100 * k, (at, at), (grid,), (samples,)))
    return found


def tiles_of(store: Store) -> list[Any]:
    with store.read() as connection:
        query = select(patch_tiles).order_by(*patch_tiles.primary_key.columns)
        return list(connection.execute(query).all())


def require_all_true(store: Store, brought: list[Frame]) -> None:
    with store.read() as connection:
        for taxel in TAXELS:
            channel = find_channel(connection, TILED, f"{taxel}.pressure")
            for level in (GRAIN, GRAIN + 3 * STEP):
                first, end = START - 64 >> level, START + 10**5 >> level
                found = read_ranges(connection, channel, level, [(first, end)])
                require_true(found, samples_of(brought, taxel), level)


def test_damaged_chunks_are_made_of_rows_again(store: Store) -> None:
    brought = carry_out(store, [steady(0, 60), "compact", "build"])
    whole = tiles_of(store)
    assert len({row[3] for row in whole}) > 5

    def damage(connection: Any) -> None:
        t = patch_tiles.c
        for level, chunk in connection.execute(select(t.level, t.chunk)).all()[::2]:
            here = (t.level == level) & (t.chunk == chunk)
            data = bytearray(connection.execute(select(t.data).where(here)).scalar_one())
            data[len(data) // 2] ^= 4
            connection.execute(update(patch_tiles).where(here).values(data=bytes(data)))

    store.write(damage).result(120)
    require_all_true(store, brought)
    late = steady(60, 60)
    put(store, *late, node=TILED)
    compact_all(store)
    build(store)
    require_all_true(store, brought + late)


def test_late_frames_are_read_at_once_and_built_later(store: Store) -> None:
    brought = steady(0, 100)
    carry_out(store, [brought[:40] + brought[43:], "compact", "build"])
    require_all_true(store, brought[:40] + brought[43:])
    put(store, *brought[40:43], node=TILED)
    require_all_true(store, brought)
    compact_all(store)
    require_all_true(store, brought)
    with store.read() as connection:
        marked = connection.execute(select(func.count()).select_from(stale_patch_chunks))
        assert marked.scalar_one() > 0
    build(store)
    require_all_true(store, brought)
    built = tiles_of(store)
    carry_out(store, [brought, "compact", "build"])
    assert [row[3:5] for row in tiles_of(store)] == [row[3:5] for row in built]


def test_chunk_that_changed_meanwhile_is_built_again(store: Store) -> None:
    brought = steady(0, 100)
    carry_out(store, [brought[:42] + brought[45:], "compact", "build"])
    put(store, *brought[42:43], node=TILED)
    compact_all(store)
    place = patch_tile_builder.find_stale(store, None)
    assert place is not None
    with store.read() as connection:
        made = patch_tile_builder._build(connection, place)
    assert made is not None
    put(store, *brought[43:45], node=TILED)
    compact_all(store)
    assert not store.write(lambda c: patch_tile_builder._write(c, made)).result(120)
    require_all_true(store, brought)
    build(store)
    require_all_true(store, brought)


def test_building_holds_up_no_writer(
    store: Store, place: StoreLocation, monkeypatch: pytest.MonkeyPatch
) -> None:
    brought, late = steady(0, 100), iter(steady(100, 100))
    carry_out(store, [brought, "compact"])
    results: list[str] = []

    def fold_between_writes(*arguments: Any) -> Any:
        for writer in (store, other):
            frame = next(late)
            brought.append(frame)
            results.extend(each.result for each in put(writer, frame, node=TILED).results)
        return fold_chunks(*arguments)

    with Store(place, clock=store.clock) as other, monkeypatch.context() as patch:
        patch.setattr(patch_tile_builder, "fold_chunks", fold_between_writes)
        build(store)
    assert len(results) >= 2
    assert set(results) == {STORED}
    assert tiles_of(store)
    require_all_true(store, brought)


def test_fault_while_tiles_are_written_leaves_the_old_ones(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    brought = steady(0, 100)
    carry_out(store, [brought[:40] + brought[43:], "compact", "build"])
    before = tiles_of(store)
    put(store, *brought[40:43], node=TILED)
    compact_all(store)

    def fail(*_: Any) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(patch_tile_builder, "insert", fail)
        with pytest.raises(StoreError):
            build(store)
    assert tiles_of(store) == before
    build(store)
    require_all_true(store, brought)


def test_row_of_many_chunks_makes_tiles_longer(store: Store) -> None:
    """As where a node samples each nanosecond at first, and each second later."""
    brought = steady(0, 100)
    carry_out(store, [brought, "compact", "build"])
    lo = np.zeros((10, COLUMNS))
    samples = PatchSamples.pack(
        Interval(lo, lo + 1.0), SKEWED.least_width, patch=0, grid=0, first_row=0
    )
    grid = Grid(0, 10**9, 0, 10, 1.0)
    name = LAYOUTS[SKEWED.content_hash].content_hash
    at = START + 10**6
    slow = Frame(Position(3, 0), name, 0, 0, (at, at), (grid,), (samples,))
    put(store, slow, node=TILED)
    for page in find_compactable_frames(store, ALL):
        while page[1] == TILED and compact_frames(store, page, ALL):
            pass
    build(store)
    with store.read() as connection:
        channel = find_channel(connection, TILED, "t0.pressure")
        assert channel["grain"] > GRAIN
        assert connection.execute(select(func.count()).select_from(patch_tiles)).scalar_one() < 1000
        level = channel["grain"]
        stretch = START >> level, (START + 2 * 10**10 >> level) + 1
        found = read_ranges(connection, channel, level, [stretch])
        require_true(found, samples_of([*brought, slow], "t0"), level)


def made_of(*columns: Any) -> Aggregates:
    return Aggregates(*columns)


@settings(deadline=None)
@given(data=st.data(), columns=st.integers(1, 5))
def test_aggregates_come_back_and_sums_enclose(data: st.DataObject, columns: int) -> None:
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    counts = random.integers(0, 9, columns)
    size, column = int(counts.sum()), np.repeat(np.arange(columns), counts)
    if not size:
        return
    first = np.concatenate([np.sort(random.integers(0, 2**60, n)) for n in counts])
    whole = random.integers(1, 2**40, (5, size))
    exponent = data.draw(st.sampled_from([-1000, -3, 0, 900]))
    lo = random.integers(-(2**20), 2**20, size) * 2.0**exponent
    hi = lo + random.integers(0, 99, size) * 2.0**exponent
    lo[random.random(size) < 0.2] = -np.inf
    hi[random.random(size) < 0.2] = np.inf
    pieces = made_of(first, *whole, lo, hi, whole[1] * lo, whole[1] * hi, random.random(size))
    taxels = tuple(f"t{k}" for k in range(columns))
    given_ = ColumnAggregates((b"a", b"b"), taxels, exponent, column, pieces)
    packed = pack(given_)
    read = unpack(packed).all(taxels)
    assert (read.names, read.column.tolist()) == ((b"a", b"b"), column.tolist())
    for name in ("first", "last", "n", "breaks", "dt", "error", "coverage", "lo", "hi"):
        assert getattr(read.pieces, name).tolist() == getattr(pieces, name).tolist()
    assert np.all(read.pieces.sum_lo <= pieces.sum_lo)
    assert np.all(read.pieces.sum_hi >= pieces.sum_hi)
    assert pack(read) == packed  # else sums would drift each time that a chunk is written
    chosen = data.draw(st.integers(0, columns - 1))
    assert unpack(packed).of(chosen).lo.tolist() == lo[column == chosen].tolist()


@given(data=st.data())
def test_other_bytes_are_refused_or_read(data: st.DataObject) -> None:
    whole = list(np.arange(1, 19).reshape(6, 3))
    pieces = made_of(*whole, *np.ones((5, 3)))
    column = np.array([0, 0, 1])
    good = bytearray(pack(ColumnAggregates((b"a",), ("t0", "t1"), 0, column, pieces)))
    for _ in range(data.draw(st.integers(1, 3))):
        good[data.draw(st.integers(0, len(good) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        unpack(bytes(good)).all(("t0", "t1"))
    except MessageError:
        return


def test_chunks_hold_as_many_tiles_as_stated(store: Store) -> None:
    carry_out(store, [steady(0, 100), "compact", "build"])
    for row in tiles_of(store):
        first = unpack(row[5]).all(TAXELS).pieces.first
        assert np.all(first >> (row[3] + PATCH_CHUNK) == row[4])
