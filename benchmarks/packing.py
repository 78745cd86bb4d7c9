"""Packs and compressed blocks beside what they are made of: bytes a sample, samples read a second.

``python -m benchmarks.packing`` measures them alone.
"""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.report import Row
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from eskin.wire.messages.compacted_block import Kept, Pack, pack
from eskin.wire.messages.compression import compress_all
from eskin.wire.messages.concatenated import Joined
from eskin.wire.messages.stored_bounds import read_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_DT: Final = 1_000_000
_MOST_BYTES: Final = 2.0
_LEAST_RATE: Final = 200.0
_ROUNDS: Final = 15
_NOISE: Final = {"smooth": 0.0, "with noise of 0.1 %": 1e-3, "of noise alone": np.inf}
"""Standard deviation, of a sine's amplitude."""


def measure_packing() -> list[Row]:
    """Bytes a sample of signals with more and more noise, and samples a second on one core."""
    rows = []
    for name, noise in _NOISE.items():
        blocks = _blocks(8, 250, noise)
        n, plain = 8 * 250, sum(len(kept.data) for kept in blocks)
        packed = len(pack(blocks)) / n
        target = _MOST_BYTES if noise < np.inf else None
        met = None if target is None else packed <= target
        ratio = plain / n / packed
        title = f"bytes a sample in a pack, signal {name}"
        rows.append(Row(title, packed, "bytes", "q16 block", plain / n, ratio, None, met))
        rows.append(_compression(name, noise))
    return [*rows, *_speed(), *_speed_of_compression()]


def _compression(name: str, noise: float) -> Row:
    blocks = [kept.data for kept in _blocks(8, 250, noise, Encoding.F32)]
    n, plain = 8 * 250, sum(map(len, blocks))
    made = sum(len(short or b"") for short in compress_all(Joined.of(blocks)))
    title = f"bytes a sample compressed, signal {name}"
    return Row(
        title, made / n, "bytes", "f32 block", plain / n, plain / made, 1.0, 0 < made < plain
    )


def _speed() -> list[Row]:
    long = Pack.read(pack(_blocks(64, 1000, 1e-3)))
    blocks = _blocks(8, 250, 1e-3)
    packed = pack(blocks)
    rate = 64_000 / _seconds(long.bounds) / 1e6
    whole = 2000 / _seconds(lambda: read_bounds(packed)) / 1e6
    plain = 2000 / _seconds(lambda: [read_bounds(kept.data) for kept in blocks]) / 1e6
    return [
        Row("samples unpacked by the kernel on one core", rate, "M/s", None, None, None,
            _LEAST_RATE, rate >= _LEAST_RATE),
        Row("samples read from a pack of 8 blocks of 250", whole, "M/s", "from q16 blocks",
            plain, whole / plain),
    ]  # fmt: skip


def _speed_of_compression() -> list[Row]:
    blocks = [kept.data for kept in _blocks(64, 500, 1e-3, Encoding.F32)]
    joined = Joined.of(blocks)
    short = [each for each in compress_all(joined) if each is not None]
    made = 32_000 / _seconds(lambda: compress_all(joined)) / 1e6
    read = 32_000 / _seconds(lambda: [read_bounds(each) for each in short]) / 1e6
    plain = 32_000 / _seconds(lambda: [read_bounds(each) for each in blocks]) / 1e6
    return [
        Row("samples of f32 compressed on one core", made, "M/s"),
        Row("samples read from compressed blocks of 500", read, "M/s", "from f32 blocks",
            plain, read / plain),
    ]  # fmt: skip


def _seconds(call: Callable[[], object]) -> float:
    """The processor's time of one call, whoever else uses it."""
    call()
    times = []
    for _ in range(_ROUNDS):
        begun = time.thread_time()
        for _ in range(100):
            call()
        times.append((time.thread_time() - begun) / 100)
    return median(times)


def _blocks(count: int, n: int, noise: float, encoding: Encoding = Encoding.Q16) -> Sequence[Kept]:
    random = np.random.default_rng(5)
    t = np.arange(count * n)
    values = random.normal(0.0, 1.0, t.size)
    if noise < np.inf:
        values = np.sin(t / 300) + noise * values
    found = []
    for k in range(count):
        tube = Interval.relative(5e-11 * (2.0 + 0.2 * values[k * n : (k + 1) * n]), 0.01)
        first = k * n * _DT
        made = Tube((first, first + 4_000_000), _DT, tube, "F", 1.0)
        block = Block.pack(Position(1, k), "t01.capacitance", first, made, encoding)
        found.append(Kept(block.encode(), k, first))
    return found


def main() -> None:
    """Say it line by line."""
    for row in measure_packing():
        print(f"{row.name}: {row.value:.3g} {row.unit}; {row.peer}: {row.peer_value}")


if __name__ == "__main__":
    main()
