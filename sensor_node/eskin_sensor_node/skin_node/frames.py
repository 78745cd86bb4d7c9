"""Frames of a stretch of time: one a page of the layout, with the truth behind each."""

from __future__ import annotations

from itertools import chain, groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Sampling, encode_samples

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames import Layout, Patch
    from eskin_sensor_node.columns.stretch import PatchColumns, SkinStretch
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.message_writer import MessageWriter, PatchSamples, Record


class WrittenFrame(NamedTuple):
    """A frame, and what was true.

    Attributes:
        record: The message.
        sizes: Number and samples of each patch, shape ``(patches, 2)``.
        values: True values: patch after patch, row after row.
    """

    record: Record
    sizes: NDArray[np.uint32]
    values: Floats


class FrameWriter:
    """Writes the frames of a skin.

    Args:
        layout: By which they are read.
        patches: The descriptions that it names, in its order.
    """

    def __init__(self, layout: Layout, patches: Sequence[Patch]) -> None:
        self._page_of = list(chain.from_iterable([k] * n for k, n in enumerate(layout.pages)))
        self._least_widths = [patch.least_width for patch in patches]

    def write(
        self, stretch: SkinStretch, clock: Clock, message_writer: MessageWriter
    ) -> Iterator[WrittenFrame]:
        """Write a frame for each page that has samples.

        Args:
            stretch: What was measured.
            clock: What the node knows of time.
            message_writer: Numbers the messages.
        """
        lasting = stretch.end - stretch.begin
        time = clock.enclosure(stretch.begin, lasting)
        for page, found in groupby(stretch.patches, lambda each: self._page_of[each.patch]):
            patches = list(found)
            used = list(dict.fromkeys(each.grid for each in patches))
            sizes = np.array([(each.patch, each.lo.size) for each in patches], np.uint32)
            record = message_writer.frame(
                page,
                stretch.begin,
                time,
                [stretch.grids[grid] for grid in used],
                [self._encoded(each, stretch, used.index(each.grid)) for each in patches],
                samples=int(sizes[:, 1].sum()),
                lasting=lasting,
            )
            values = np.concatenate([each.truth.ravel() for each in patches])
            yield WrittenFrame(record, sizes, values)

    def _encoded(self, patch: PatchColumns, stretch: SkinStretch, grid: int) -> PatchSamples:
        rows, columns = patch.lo.shape
        sampling = Sampling(rows, columns, stretch.grids[patch.grid].first_row)
        width = self._least_widths[patch.patch]
        codes = encode_samples(Interval(patch.lo, patch.hi), sampling, width)
        return patch.patch, grid, patch.epoch, columns, *codes
