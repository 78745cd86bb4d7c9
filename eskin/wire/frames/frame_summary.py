"""A frame without its samples: where each patch's record stands, and the hull of its samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import cbor2
import numpy as np

from eskin.wire.frames.frame import Frame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.wire.frames.frame import Grid
    from eskin.wire.messages.header import Position

PATCH_RECORD: Final = np.dtype(
    [
        ("patch", "<u2"),
        ("grid", "<u2"),
        ("columns", "<u2"),
        ("strided", "<u2"),
        ("offset", "<u4"),
        ("length", "<u4"),
        ("samples", "<u4"),
        ("epoch", "<i8"),
        ("lo", "<f8"),
        ("hi", "<f8"),
    ]
)
"""What is known of a patch in a frame, without its samples.

``offset`` and ``length`` are those of its CBOR item in the frame; ``strided`` is 1 where not every
row has a sample of each column; ``lo`` and ``hi`` are the hull of its samples, infinite where one
of them is unknown on that side.
"""


class FrameSummary(NamedTuple):
    """A frame without its samples; a tuple, because there are many.

    Attributes:
        position: Boot and sequence.
        layout: Hash of the layout by which it is read.
        page: Number of its page in the layout.
        ticks: The node's clock at the first moment, ns since its start.
        time: Enclosure of the same moment, UTC ns.
        grids: When patches were sampled.
        records: Of each patch, a `PATCH_RECORD`.
    """

    position: Position
    layout: bytes
    page: int
    ticks: int
    time: tuple[int, int]
    grids: tuple[Grid, ...]
    records: NDArray[Any]

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a frame; all samples are decoded and checked, not kept.

        Raises:
            MessageError: It is none.
        """
        return cls.of(Frame.decode(data), len(data))

    @classmethod
    def of(cls, frame: Frame, size: int) -> Self:
        """The summary of a frame.

        Args:
            frame: The frame.
            size: Bytes of its encoding, which ends with the patches.
        """
        records = np.zeros(len(frame.patches), PATCH_RECORD)
        for record, patch, values in zip(records, frame.patches, frame.values, strict=True):
            sampling = patch.sampling(frame.grids[patch.grid])
            lo, hi = values.inf, values.sup
            if patch.strides:
                lo, hi = lo[sampling.mask], hi[sampling.mask]
            record["patch"], record["grid"] = patch.patch, patch.grid
            record["columns"], record["strided"] = patch.columns, bool(patch.strides)
            record["length"] = len(cbor2.dumps(patch.encode()))
            record["samples"], record["epoch"] = sum(sampling.counts), patch.epoch
            record["lo"], record["hi"] = lo.min(), hi.max()
        ends = size - np.cumsum(records["length"][::-1], dtype=np.int64)[::-1]
        records["offset"] = ends
        return cls(
            position=frame.position,
            layout=frame.layout,
            page=frame.page,
            ticks=frame.ticks,
            time=frame.time,
            grids=frame.grids,
            records=records,
        )
