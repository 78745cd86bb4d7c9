"""Frames in the stream of events: hulls of their channels in JSON."""

from __future__ import annotations

import asyncio
from contextlib import aclosing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.store import Store

from eskin.errors import StoreError
from eskin.interval import Interval
from eskin.wire.frames import Frame, PatchSamples
from eskin.wire.timestamp import format_timestamp
from tests.unit.cloud.clouds import batch, forget_recent
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.skins import FAST, HAND, PALM, PATCHES, describe, frame
from tests.unit.cloud.streams import events_of, listen, take

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
LENGTH = FAST.rows * FAST.period


def described(stand: Stand) -> None:
    describe(stand.cloud.store, HAND, *PATCHES)


async def frames_of(stand: Stand, count: int, **options: Any) -> list[dict[str, Any]]:
    """The first frames of a stream."""
    found: list[dict[str, Any]] = []
    async with asyncio.timeout(20), aclosing(listen(stand, **options)) as pieces:  # type: ignore[type-var]  # a generator
        async for piece in pieces:
            found += [each for each in events_of(piece) if each["event"] == "frame"]
            if len(found) >= count:
                break
    return found


def hull(said: Frame, at: int) -> tuple[list[float], list[float]]:
    values = said.values[at]
    return values.inf.min(axis=0).tolist(), values.sup.max(axis=0).tolist()


async def test_frame_is_the_hull_of_each_channel(stand: Stand) -> None:
    described(stand)
    said = [frame(0), frame(1, page=1)]
    await stand.ingest(batch(*said))
    first, second = (each["data"] for each in await frames_of(stand, 2))
    assert (first["node"], first["layout"], first["page"]) == (NODE, HAND.content_hash.hex(), 0)
    assert first["t0"] == format_timestamp(START + 2000)
    assert first["time_error"] == 2000
    assert first["stored"] == format_timestamp(stand.clock())
    palm, warm = first["patches"]
    assert (palm["patch"], palm["unit"], palm["n"]) == ("palm", "Pa", FAST.rows)
    assert (palm["t"], palm["dt"]) == (FAST.delay, LENGTH)
    assert (palm["lo"], palm["hi"]) == hull(said[0], 0)
    assert (warm["lo"], warm["hi"], warm["n"]) == (*hull(said[0], 1), 1)
    assert warm["coverage"] <= 0.999
    assert warm["coverage"] == pytest.approx(0.999)
    assert [each["patch"] for each in second["patches"]] == ["tip"]
    assert "channels" not in palm


async def test_rows_become_as_many_hulls_as_are_asked_for(stand: Stand) -> None:
    described(stand)
    said = frame(0, page=1)
    await stand.ingest(batch(said))
    chosen = Subscription(frozenset({NODE}), frozenset(), 2)
    (document,) = (each["data"] for each in await frames_of(stand, 1, selection=chosen))
    early, late = document["patches"]
    assert (early["n"], late["n"]) == (3, 2)
    assert (early["t"], early["dt"]) == (FAST.delay, 3 * FAST.period)
    assert (late["t"], late["dt"]) == (FAST.delay + 3 * FAST.period, 2 * FAST.period)
    values = said.values[0]
    for each, rows in ((early, slice(3)), (late, slice(3, 5))):
        assert each["patch"] == "tip"
        assert each["lo"] == values.inf[rows].min(axis=0).tolist()
        assert each["hi"] == values.sup[rows].max(axis=0).tolist()


def frame_with_strides(lo: NDArray[np.float64]) -> Frame:
    """A frame whose second and third column are sampled at each fourth and each eighth row."""
    packed = PatchSamples.pack(
        Interval(lo, lo + 64.0), 64.0, patch=0, grid=0, first_row=FAST.first_row,
        strides=bytes((0, 2, 3)),
    )  # fmt: skip
    return replace(frame(0), grids=(FAST,), patches=(packed,))


async def test_a_hull_without_a_sample_has_no_bounds(stand: Stand) -> None:
    described(stand)
    lo = np.arange(15.0).reshape(5, 3) * 100
    await stand.ingest(batch(frame_with_strides(lo)))
    chosen = Subscription(frozenset({NODE}), frozenset(), 5)
    ((_, _, third, fourth, _),) = (
        each["data"]["patches"] for each in await frames_of(stand, 1, selection=chosen)
    )
    # Row 750 + 2 is the only one that has all columns.
    assert (third["lo"], third["hi"]) == (lo[2].tolist(), (lo[2] + 64.0).tolist())
    assert (fourth["lo"], fourth["hi"]) == ([lo[3, 0], None, None], [lo[3, 0] + 64.0, None, None])


async def test_hull_leaves_out_cells_that_are_not_sampled(stand: Stand) -> None:
    described(stand)
    lo = np.arange(15.0).reshape(5, 3) * 100
    await stand.ingest(batch(frame_with_strides(lo)))
    ((only,),) = (each["data"]["patches"] for each in await frames_of(stand, 1))
    # Row 750 + 2 is a multiple of four; none from 750 to 754 but 752 is one of eight.
    assert only["lo"] == [0.0, lo[2, 1], lo[2, 2]]
    assert only["hi"] == [lo[4, 0] + 64.0, lo[2, 1] + 64.0, lo[2, 2] + 64.0]


async def test_channel_narrows_frames_to_its_column(stand: Stand) -> None:
    described(stand)
    said = [frame(0), frame(1, page=1), frame(2, at=LENGTH)]
    await stand.ingest(batch(*said))
    chosen = Subscription(frozenset(), frozenset({(NODE, PALM.channels[1])}))
    found = [each["data"] for each in await frames_of(stand, 2, selection=chosen)]
    for document, each in zip(found, (said[0], said[2]), strict=True):
        (patch,) = document["patches"]
        assert patch["channels"] == [PALM.channels[1]]
        lo, hi = hull(each, 0)
        assert (patch["lo"], patch["hi"]) == ([lo[1]], [hi[1]])


async def test_slow_reader_gets_fewer_and_wider_hulls_without_a_hole(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.live.stream.PAUSE_S", 1e-9)
    monkeypatch.setattr("eskin_cloud.live.stream.PATIENCE_S", -1.0)
    described(stand)
    said = [frame(k, page=1, at=k * LENGTH, seed=k) for k in range(4)]
    late = frame(9, page=1, at=9 * LENGTH, seed=9)  # some are missing before it
    chosen = Subscription(frozenset({NODE}), frozenset())
    async with aclosing(listen(stand, selection=chosen)) as slow:  # type: ignore[type-var]  # a generator
        await anext(slow)
        await stand.ingest(batch(said[0]))
        assert [each["event"] for each in events_of(await anext(slow))][-1] == "frame"
        assert await anext(slow) == b""
        await stand.ingest(batch(*said[1:], late))
        heard = [each["data"] for each in events_of(await anext(slow))]
    first, second = (each["patches"][0] for each in heard)
    assert (first["n"], first["dt"]) == (3 * FAST.rows, 3 * LENGTH)
    hulls = [hull(each, 0) for each in said[1:]]
    assert first["lo"] == np.min([lo for lo, _ in hulls], axis=0).tolist()
    assert first["hi"] == np.max([hi for _, hi in hulls], axis=0).tolist()
    assert (second["lo"], second["hi"]) == hull(late, 0)
    assert heard[0]["t0"] == format_timestamp(START + LENGTH + 2000)


async def test_frames_are_read_back_from_the_store(stand: Stand) -> None:
    described(stand)
    await stand.ingest(batch(frame(0), frame(1, page=1)))
    before = await take(stand, 2)
    forget_recent(stand)
    assert await take(stand, 2) == before


async def test_layout_that_a_fault_kept_from_being_read_is_read_for_the_next_stream(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    described(stand)
    await stand.ingest(batch(frame(0)))
    read = Store.read
    faults = iter([StoreError("the server went away")])

    def faulty(self: Store) -> AbstractContextManager[Connection]:
        fault = next(faults, None)
        if fault is not None:
            raise fault
        return read(self)

    monkeypatch.setattr(Store, "read", faulty)
    async with asyncio.timeout(20):  # the client that has lost its stream connects again
        assert [each async for each in listen(stand)][1:] == []
    assert next(faults, None) is None
    assert len(await frames_of(stand, 1)) == 1


async def test_reader_without_the_scope_gets_frames(stand: Stand) -> None:
    described(stand)
    await stand.ingest(batch(frame(0), frame(1, page=1)))
    assert len(await frames_of(stand, 2, sealed=False)) == 2
    resumed = await frames_of(stand, 1, sealed=False, cursor=1)
    assert len(resumed) == 1
