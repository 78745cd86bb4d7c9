"""``tests.unit.cloud.first_use STORE [warm]``: which compiled code is loaded by first blocks.

They are stored, folded, packed and asked for, in a process that did nothing of it before. Each name
that had to be loaded then is printed; with "warm", of those that its warm-up had not loaded.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import compact_page, find_compactable
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.warm_up import warm_up
from numba.core.caching import Cache

from eskin.wire.messages import Encoding
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, block

_SPAN = 100 * DT
_MANY = 40


def main(place: Path, *, warm: bool) -> None:
    """Do it all, and print."""
    sent = [_encoded(number) for number in range(2 * _MANY)]
    if warm:
        warm_up()
    look_up: Any = Cache.load_overload

    def told(cache: Any, *of: Any) -> Any:
        sys.stdout.write(f"{cache._py_func.__name__}\n")
        return look_up(cache, *of)

    with patch.object(Cache, "load_overload", told), Store(place) as store:
        _work(store, sent)


def _encoded(number: int) -> bytes:
    """Blocks in `Encoding.Q16`, and then in `Encoding.F32`."""
    lo = np.sin(np.arange(100) / 9 + number)
    begin = START + number * _SPAN
    encoding = Encoding.Q16 if number < _MANY else Encoding.F32
    return block(number + 1, lo, lo + 1.5, time=(begin, begin), encoding=encoding).encode()


def _work(store: Store, sent: list[bytes]) -> None:
    put_items(store, ParsedMessage.parse_all([(NODE, data) for data in sent]))
    build(store)
    for channel in find_compactable(store, 0):
        while compact_page(store, channel, 0):
            pass
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        read_series(connection, row, Window(START, START + 2 * _MANY * _SPAN), points=500)


if __name__ == "__main__":
    main(Path(sys.argv[1]), warm=sys.argv[2:] == ["warm"])
