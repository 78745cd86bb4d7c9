"""Load the compiled code of ingest, pyramid and compaction before the first request."""

from __future__ import annotations

import logging
import time

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import (
    DescribedLayout,
    EncodedFrame,
    Frame,
    Grid,
    Layout,
    Patch,
    PatchSamples,
    decode_samples,
)
from eskin.wire.frames.frame_scan import scan_frames
from eskin.wire.messages import Position
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.column_aggregates import pack as pack_tiles
from eskin_cloud.rollup.column_aggregates import unpack as unpack_tiles
from eskin_cloud.rollup.patch_folding import fold_runs
from eskin_cloud.store.frame_row import fit_frame
from eskin_cloud.store.patch_rows import decode_runs, encode_runs
from eskin_cloud.store.patch_run import PatchRun

log = logging.getLogger(__name__)

_SLOW_S = 2.0


def warm_up() -> None:
    """Read a frame, decode its samples, compact them, and fold them into tiles."""
    begun = time.monotonic()
    patch = Patch("t", "pressure", "Pa", ("t",), 1.0)
    layout = Layout((patch.content_hash,), (1,))
    grid = Grid(0, 1, 0, 1, 1.0)
    samples = PatchSamples.pack(Interval([[0.0]], [[1.0]]), 1.0, patch=0, grid=0, first_row=0)
    frame = Frame(Position(1, 1), layout.content_hash, 0, 0, (0, 0), (grid,), (samples,))
    data = frame.encode()
    fit_frame(EncodedFrame.decode(data), DescribedLayout.of(layout, (patch,)))
    scan_frames([data], np.ones(1, np.bool_))
    read = decode_samples(samples.samples, samples.sampling(grid))
    _warm_up_rows(patch, read)
    if (took := time.monotonic() - begun) > _SLOW_S:
        log.info("kernels compiled: seconds=%.1f", took)


def _warm_up_rows(patch: Patch, values: Interval) -> None:
    """Compact a frame, fold it into tiles, and read both."""
    name = patch.content_hash
    place = name, 1, 1, 0, 0, 0, 1, 0, b"", 0, (), 1.0
    runs = decode_runs(encode_runs([PatchRun(*place, values.inf, values.sup)]))
    folded = fold_runs(runs, {name: patch}, Buckets(0, 1, 1))
    tiles = unpack_tiles(pack_tiles(folded.grouped(1)))
    tiles.of(0)
