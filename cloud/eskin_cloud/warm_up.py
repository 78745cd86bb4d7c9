"""Load the compiled code of ingest, pyramid and compaction before the first request."""

from __future__ import annotations

import logging
import time

import numpy as np

from eskin.interval import Interval
from eskin.runtime.digest import digest
from eskin.tube import Tube
from eskin.wire.frames import Frame, Grid, PatchSamples, decode_samples
from eskin.wire.frames.content_hash import HASH_BYTES
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compacted_block import Kept, Pack, pack
from eskin.wire.messages.compression import decompress
from eskin.wire.messages.stored_bounds import read_bounds
from eskin.wire.messages.warm_up import warm_up as warm_up_messages
from eskin_cloud.rollup.aggregates import Aggregates
from eskin_cloud.rollup.blocks import Buckets, fold
from eskin_cloud.store.damage import RowHeader
from eskin_cloud.store.write.block_row import BlockRow
from eskin_cloud.store.write.parsed_message import ParsedMessage

log = logging.getLogger(__name__)

_SLOW_S = 2.0
_MANY = 64
"""Samples enough for a block to be shorter when it is compressed."""


def warm_up() -> None:
    """Take a block the whole way: read it, fold it into the pyramid, pack it, and read the pack.

    One of ``f32`` is compressed as well, and read. A frame is read, and its samples are decoded.
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
    grid = Grid(0, 1, 0, 1, 1.0)
    patch = PatchSamples.pack(Interval([[0.0]], [[1.0]]), 1.0, patch=0, grid=0, first_row=0)
    frame = Frame(Position(1, 1), bytes(HASH_BYTES), 0, 0, (0, 0), (grid,), (patch,))
    ParsedMessage.parse("t", frame.encode())
    decode_samples(patch.samples, patch.sampling(grid))
