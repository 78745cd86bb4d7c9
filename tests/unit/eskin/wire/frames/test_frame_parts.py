"""Parts of a frame are those that the whole decoder reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, PatchSamples
from eskin.wire.frames.frame import read_head, replace_sequence, select_patches
from eskin.wire.messages import Position
from tests.unit.eskin.wire.frames.examples import FRAME, LAYOUT, PALM, head_fields

_GRIDS = tuple(Grid(delay, 1000, 0, rows, 1.0) for delay, rows in ((0, 2), (7, 3), (9, 1)))


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    """Frames of one-column patches with up to three grids, used in any order."""
    numbers = sorted(draw(st.sets(st.integers(0, 1999), min_size=1, max_size=6)))
    chosen = [draw(st.integers(0, 2)) for _ in numbers]
    used = list(dict.fromkeys(chosen))
    patches = []
    for number, grid in zip(numbers, chosen, strict=True):
        lo = np.array([[draw(st.floats(-1e6, 1e6))]] * _GRIDS[grid].rows)
        values = Interval(lo, lo + 1.0)
        patches.append(
            PatchSamples.pack(values, 1.0, patch=number, grid=used.index(grid), first_row=0)
        )
    return replace(FRAME, grids=tuple(_GRIDS[grid] for grid in used), patches=tuple(patches))


@given(frames(), st.integers(0, 2**63 - 1), st.integers(0, 255))
def test_head_is_that_of_the_whole_frame(frame: Frame, ticks: int, page: int) -> None:
    whole = replace(frame, ticks=ticks, page=page, position=Position(3, ticks % 2**53))
    head = read_head(whole.encode())
    assert head_fields(head) == head_fields(whole)
    assert head.stretch == (3, ticks)


@given(frames(), st.integers(0, 2**53 - 1))
def test_replaced_sequence_is_the_only_change(frame: Frame, sequence: int) -> None:
    position = Position(frame.position.boot, sequence)
    assert replace_sequence(frame.encode(), sequence) == replace(frame, position=position).encode()


@given(frames(), st.data())
def test_selected_patches_are_the_same_samples_in_the_only_encoding(
    frame: Frame, data: st.DataObject
) -> None:
    numbers = [each.patch for each in frame.patches]
    wanted = data.draw(st.sets(st.sampled_from(numbers)))
    reduced = select_patches(frame.encode(), wanted)
    if not wanted:
        assert reduced is None
        return
    assert reduced is not None
    read = Frame.decode(reduced)  # which refuses grids in another order, or without a patch
    assert read.encode() == reduced
    of_whole = {
        each.patch: (frame.grids[each.grid], each.samples, values)
        for each, values in zip(frame.patches, frame.values, strict=True)
    }
    assert {each.patch for each in read.patches} == wanted
    for each, values in zip(read.patches, read.values, strict=True):
        grid, samples, before = of_whole[each.patch]
        assert (read.grids[each.grid], each.samples) == (grid, samples)
        assert np.array_equal(values.inf, before.inf)
        assert np.array_equal(values.sup, before.sup)
    assert (read.position, read.layout, read.ticks) == (frame.position, frame.layout, frame.ticks)


@pytest.mark.parametrize("data", [b"", b"\xa9", PALM.encode(), LAYOUT.encode(), FRAME.encode()[:9]])
def test_other_messages_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        read_head(data)


@pytest.mark.parametrize("data", [b"", PALM.encode(), FRAME.encode()[:-1]])
def test_no_patch_is_selected_of_other_messages(data: bytes) -> None:
    with pytest.raises(MessageError):
        select_patches(data, {0})
