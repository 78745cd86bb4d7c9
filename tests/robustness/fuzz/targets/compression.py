"""Compressed blocks: what is compressed comes back, and what was damaged is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compression import compress_all, decompress, is_compressed
from eskin.wire.messages.concatenated import Joined
from eskin.wire.messages.stored_bounds import read_bounds
from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path


def make(_: Path) -> Target:
    """The input is a message, or a compressed block; only `MessageError`, and no byte is lost."""
    t = np.arange(300)
    waves = [np.sin(t[:n] / 9.0) for n in (40, 256, 300)]
    tubes = [Tube((0, 5), 10, Interval(wave, wave + 0.5), "F", 1.0) for wave in waves]
    missing = np.where(t % 50 == 3, np.inf, 1.0)
    tubes.append(Tube((0, 5), 10, Interval(-missing, missing), "F", 1.0))
    said = [Block.pack(Position(1, 7), "t01.x", 0, tube, Encoding.F32).encode() for tube in tubes]
    short = [each for each in compress_all(Joined.of(said)) if each is not None]
    return Target((*said, *short), mutate_octets, check)


def check(data: bytes) -> None:
    """Read it as what lies in a store, and as what comes among others."""
    if is_compressed(data):
        try:
            whole = decompress(data)
        except MessageError:
            return
        lo, hi = read_bounds(data)
        assert len(whole) >= 4 * (lo.size + hi.size)
    among = [b"\xaf", data, data[: len(data) // 2], data]
    for message, short in zip(among, compress_all(Joined.of(among)), strict=True):
        if short is not None:
            assert len(short) < len(message)
            assert decompress(short) == message
