"""Load the compiled code of ingest, pyramid and compaction before the first request."""

from __future__ import annotations

import logging
import time

import numpy as np

from eskin.interval import Interval
from eskin.runtime.digest import digest
from eskin.tube import Tube
from eskin.wire.frames import (
    DescribedLayout,
    Frame,
    FrameSummary,
    Grid,
    Layout,
    Patch,
    PatchSamples,
    decode_samples,
)
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compacted_block import Kept, Pack, pack
from eskin.wire.messages.compression import decompress
from eskin.wire.messages.stored_bounds import read_bounds
from eskin.wire.messages.warm_up import warm_up as warm_up_messages
from eskin_cloud.rollup.aggregates import Aggregates
from eskin_cloud.rollup.blocks import Buckets, fold
from eskin_cloud.rollup.column_aggregates import pack as pack_tiles
from eskin_cloud.rollup.column_aggregates import unpack as unpack_tiles
from eskin_cloud.rollup.patch_folding import fold_runs
from eskin_cloud.store.damage import RowHeader
from eskin_cloud.store.frame_row import fit_frame
from eskin_cloud.store.patch_rows import decode_runs, encode_runs
from eskin_cloud.store.patch_run import PatchRun
from eskin_cloud.store.write.block_row import BlockRow
from eskin_cloud.store.write.parsed_message import ParsedMessage

log = logging.getLogger(__name__)

_SLOW_S = 2.0
_MANY = 64
"""Samples enough for a block to be shorter when it is compressed."""


def warm_up() -> None:
    """Take a block the whole way: read it, fold it into the pyramid, pack it, and read the pack.

    One of ``f32`` is compressed as well, and read. A frame is read, and its samples are decoded,
    compacted, and folded into tiles.
    """
    begun = time.monotonic()
    block = warm_up_messages()
    tube, data = block.tube, block.encode()
    buckets = Buckets(0, len(tube) * tube.dt, 1)
    said = (0, tube.dt, len(tube), tube.time_error, tube.coverage, data)
    head = BlockRow.of("", block.summary, data, digest(data), 0, 0)
    row = (*said, head.head, *RowHeader.of(head._asdict()))
    pieces = fold([row], buckets.window, buckets)
    Aggregates.unpack([pieces.grouped(buckets.of(pieces.first)).pack()])
    Pack.read(pack([Kept(data, 1, 0)])).blocks()
    _warm_up_compression(block)
    _warm_up_frames()
    if (took := time.monotonic() - begun) > _SLOW_S:
        log.info("kernels compiled: seconds=%.1f", took)


def _warm_up_compression(block: Block) -> None:
    same = Interval(np.zeros(_MANY), np.ones(_MANY))
    like = block.tube
    tube = Tube(like.time, like.dt, same, like.unit, like.coverage)
    said = Block.pack(block.position, block.channel, 0, tube, Encoding.F32).encode()
    kept = ParsedMessage.parse("t", said).compressed or b""
    decompress(kept)
    read_bounds(kept)


def _warm_up_frames() -> None:
    patch = Patch("t", "pressure", "Pa", ("t",), 1.0)
    layout = Layout((patch.content_hash,), (1,))
    grid = Grid(0, 1, 0, 1, 1.0)
    samples = PatchSamples.pack(Interval([[0.0]], [[1.0]]), 1.0, patch=0, grid=0, first_row=0)
    frame = Frame(Position(1, 1), layout.content_hash, 0, 0, (0, 0), (grid,), (samples,))
    data = frame.encode()
    fit_frame(FrameSummary.decode(data), DescribedLayout.of(layout, (patch,)), data)
    read = decode_samples(samples.samples, samples.sampling(grid))
    _warm_up_rows(patch, read)


def _warm_up_rows(patch: Patch, values: Interval) -> None:
    """Compact a frame, fold it into tiles, and read both."""
    name = patch.content_hash
    place = name, 1, 1, 0, 0, 0, 1, 0, b"", 0, (), 1.0
    runs = decode_runs(encode_runs([PatchRun(*place, values.inf, values.sup)]))
    folded = fold_runs(runs, {name: patch}, Buckets(0, 1, 1))
    tiles = unpack_tiles(pack_tiles(folded.grouped(1)))
    tiles.of(0)
