"""``tests.unit.cloud.first_use STORE [warm]``: which compiled code is loaded by first messages.

Frames are stored, compacted, folded and asked for, and one of a skin is stored and one of its
patches read, in a process that did nothing of it before. Each name that had to be loaded then is
printed; with "warm", of those that its warm-up had not loaded.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.patch_runs import read_runs
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.warm_up import warm_up
from numba.core.caching import Cache
from sqlalchemy import select

from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.skins import HAND, PALM, PATCHES, describe, frame

_SPAN = 100 * DT
_MANY = 40


def main(place: Path, *, warm: bool) -> None:
    """Do it all, and print."""
    sent = [_encoded(number) for number in range(2 * _MANY)]
    framed = frame(0, boot=2).encode()
    if warm:
        warm_up()
    look_up: Any = Cache.load_overload

    def stated(cache: Any, *of: Any) -> Any:
        sys.stdout.write(f"{cache._py_func.__name__}\n")
        return look_up(cache, *of)

    with patch.object(Cache, "load_overload", stated), Store(place) as store:
        _work(store, sent)
        _store_frame(store, framed)


def _encoded(number: int) -> bytes:
    lo = np.sin(np.arange(100) / 9 + number)
    begin = START + number * _SPAN
    return stretch(number + 1, lo, lo + 1.5, time=(begin, begin)).encode()


def _work(store: Store, sent: list[bytes]) -> None:
    put_items(store, [ParsedMessage.parse(NODE, data) for data in sent])
    _ask(store)
    compact_all(store)
    build(store)
    _ask(store)


def _ask(store: Store) -> None:
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        read_series(connection, row, Window(START, START + 2 * _MANY * _SPAN), points=500)


def _store_frame(store: Store, data: bytes) -> None:
    describe(store, HAND, *PATCHES)
    put_items(store, [ParsedMessage.parse(NODE, data)])
    with store.read() as connection:
        row = connection.execute(select(frames)).mappings().one()
        read_runs(connection, NODE, PALM.patch_id, Window(row["t"], row["t_end"] + 1))


if __name__ == "__main__":
    main(Path(sys.argv[1]), warm=sys.argv[2:] == ["warm"])
