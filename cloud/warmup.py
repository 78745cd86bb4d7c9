"""Loading what compiled code ingest, pyramid and packing use, before anybody waits for it."""

from __future__ import annotations

import logging
import time

from cloud.pyramid.blocks import Buckets, fold
from cloud.pyramid.pieces import Pieces
from eskin.messages.pack import Kept, Pack, pack
from eskin.messages.warmup import warm_up as warm_up_messages

log = logging.getLogger(__name__)

_SLOW_S = 2.0


def warm_up() -> None:
    """Take a block the whole way: read it, fold it into the pyramid, pack it, and read the pack."""
    begun = time.monotonic()
    block = warm_up_messages()
    tube, data = block.tube, block.encode()
    buckets = Buckets(0, len(tube) * tube.dt, 1)
    row = (0, tube.dt, len(tube), tube.time_error, tube.coverage, data)
    pieces = fold([row], buckets.window, buckets)
    Pieces.unpack([pieces.grouped(buckets.of(pieces.first)).pack()])
    Pack.read(pack([Kept(data, 1, 0)])).blocks()
    if (took := time.monotonic() - begun) > _SLOW_S:
        log.info("compiled what is used again and again: seconds=%.1f", took)
