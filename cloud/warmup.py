"""Loading what compiled code ingest, pyramid and packing use, before anybody waits for it."""

from __future__ import annotations

import logging
import time

import numpy as np

from cloud.pyramid.blocks import Buckets, fold
from cloud.pyramid.pieces import Pieces
from cloud.store.block_row import BlockRow
from cloud.store.damage import Head
from cloud.store.item import Item
from eskin.digest import digest
from eskin.interval import Interval
from eskin.messages import Block, Encoding
from eskin.messages.compression import decompress
from eskin.messages.pack import Kept, Pack, pack
from eskin.messages.stored import read_bounds
from eskin.messages.warmup import warm_up as warm_up_messages
from eskin.tube import Tube

log = logging.getLogger(__name__)

_SLOW_S = 2.0
_MANY = 64
"""Samples enough for a block to be shorter when it is compressed."""


def warm_up() -> None:
    """Take a block the whole way: read it, fold it into the pyramid, pack it, and read the pack.

    One of ``f32`` is compressed as well, and read.
    """
    begun = time.monotonic()
    block = warm_up_messages()
    tube, data = block.tube, block.encode()
    buckets = Buckets(0, len(tube) * tube.dt, 1)
    said = (0, tube.dt, len(tube), tube.time_error, tube.coverage, data)
    head = BlockRow.of("", block.summary, data, digest(data), 0, 0)
    row = (*said, head.head, *Head.of(head._asdict()))
    pieces = fold([row], buckets.window, buckets)
    Pieces.unpack([pieces.grouped(buckets.of(pieces.first)).pack()])
    Pack.read(pack([Kept(data, 1, 0)])).blocks()
    _warm_up_compression(block)
    if (took := time.monotonic() - begun) > _SLOW_S:
        log.info("compiled what is used again and again: seconds=%.1f", took)


def _warm_up_compression(block: Block) -> None:
    same = Interval(np.zeros(_MANY), np.ones(_MANY))
    like = block.tube
    tube = Tube(like.time, like.dt, same, like.unit, like.coverage)
    said = Block.pack(block.position, block.channel, 0, tube, Encoding.F32).encode()
    kept = Item.read("t", said).kept or b""
    decompress(kept)
    read_bounds(kept)
