"""Hulls of columns are those of the samples that `Frame.decode` finds."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eskin.wire.frames import EncodedFrame, Frame, Grid, PatchSamples
from eskin.wire.frames.column_hulls import ColumnHulls
from eskin.wire.messages import Position
from tests.unit.eskin.wire.frames.matrices import SIZES, matrices, samplings


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    """Frames of some patches, each on a grid of its own."""
    grids, patches = [], []
    for number, sampling in enumerate(draw(st.lists(samplings(), min_size=1, max_size=3))):
        assume(sum(sampling.counts))
        grids.append(Grid(number, 1000, sampling.first_row, sampling.rows, 1.0))
        strides = sampling.strides if any(sampling.strides) else b""
        epoch = draw(st.sampled_from((0, 1, 2**40)))
        patches.append(
            PatchSamples.pack(
                draw(matrices(sampling)), draw(st.sampled_from(SIZES)), patch=number * 7,
                grid=number, first_row=sampling.first_row, strides=strides, epoch=epoch,
                unshared=(0,) if epoch > 1 else (),
            )
        )  # fmt: skip
    return Frame(Position(1, 2), bytes(32), 3, 4, (-5, 6), tuple(grids), tuple(patches))


@settings(deadline=None)
@given(frame=frames())
def test_hulls_of_columns_are_those_of_the_decoded_samples(frame: Frame) -> None:
    data = frame.encode()
    found = ColumnHulls.of(EncodedFrame.decode(data))
    lo, hi, samples = [], [], []
    for patch, values in zip(frame.patches, frame.values, strict=True):
        mask = patch.sampling(frame.grids[patch.grid]).mask
        for column in range(patch.columns):
            rows = np.flatnonzero(mask[:, column])
            lo.append(min((values.inf[row, column] for row in rows), default=np.inf))
            hi.append(max((values.sup[row, column] for row in rows), default=-np.inf))
            samples.append(len(rows))
    assert found.lo.tolist() == lo
    assert found.hi.tolist() == hi
    assert found.samples.tolist() == samples
