"""Bytes of frames beside those of blocks, and the codec's speed: `python -m benchmarks.frames`.

Runs the packaged hand's firmware on its scenario as fast as it goes, and encodes its samples anew.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from eskin_sensor_node.firmware import sample_codec as firmware
from eskin_sensor_node.machine.flash.flash import Flash
from eskin_sensor_node.node.factory import build_node, build_outbox, chip_key
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings

from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.frames import Frame, Grid, PatchSamples, Sampling, decode_samples, encode_samples
from eskin.wire.messages import Block, Encoding, Position, decode_message

if TYPE_CHECKING:
    from collections.abc import Callable

_SECONDS: Final = 5
_BILLION: Final = 1_000_000_000
_ROWS: Final = (3, 12, 125)
_FAST: Final = 4_000_000
_SLOW: Final = 20_000_000
_EVERY: Final = _SLOW // _FAST
_COLUMNS: Final = 64
_REPEATS: Final = 5
_START: Final = (1_790_000_000_000_000_000, 1_790_000_000_000_004_000)


class Measured(NamedTuple):
    """Channels of one kind of taxel and one quantity.

    Attributes:
        period: ns.
        unit: UCUM code.
        values: Shape ``(samples, channels)``.
        least_width: Of all that are bounded.
    """

    period: int
    unit: str
    values: Interval
    least_width: float


def measure(folder: Path, seconds: int = _SECONDS) -> list[Measured]:
    """What the hand measures in so many seconds."""
    given: dict[str, Any] = {
        "node": {"name": "hand", "profile": "hand", "seed": 7},
        "identity": {"directory": folder, "site": folder},
        "flash": {"path": folder / "flash", "capacity_bytes": 2**30},
        "truth": {"path": folder / "truth", "limit_bytes": 2**31},
        "taxel": Profile.read("hand").taxels,
        "machine": {"ram_bytes": 2**21},  # as float64 the samples of a block take more
        "sampling": {"encoding": "f64"},
    }
    settings = NodeSettings(**given)
    flash = Flash(settings.flash.path, node="hand", key=chip_key(settings), epoch=1)
    truth = GroundTruth(settings.truth.path, limit=2**31)
    outbox = build_outbox(flash, capacity=2**30, broker=settings.broker)
    node, _ = build_node(settings, outbox=outbox, truth=truth, start=0)
    node.run_until(seconds * _BILLION)
    channels: dict[str, list[Block]] = defaultdict(list)
    for kept in flash.after((-1, -1), 1_000_000):
        message = decode_message(kept.body)
        if isinstance(message, Block):
            channels[message.channel].append(message)
    flash.close()
    truth.close()
    patches: dict[tuple[str, str], list[list[Block]]] = defaultdict(list)
    for name, blocks in channels.items():
        patches[name[0], name.partition(".")[2]].append(blocks)
    return [_patch(each) for each in patches.values()]


def _patch(channels: list[list[Block]]) -> Measured:
    columns = [Interval.concatenate([b.tube.values for b in blocks]) for blocks in channels]
    size = min(len(column) for column in columns)
    values = Interval.stack([column[:size] for column in columns], axis=1)
    widths = (values.sup - values.inf)[np.isfinite(values.sup - values.inf)]
    tube = channels[0][0].tube
    least = float(widths.min()) if widths.size else 1e-3  # such as metal that is never near
    return Measured(tube.dt, tube.unit, values, least)


def sizes(patches: list[Measured], rows: int) -> dict[str, float]:
    """Bytes a sample: of whole frames, of their codes, of blocks in two encodings."""
    total: dict[str, int] = defaultdict(int)
    for first in range(0, (_SECONDS - 1) * _BILLION // _FAST, rows):
        slow = range(-(-first // _EVERY), -(-(first + rows) // _EVERY))
        grids = [Grid(0, _FAST, first, rows, 1.0)]
        if slow:
            delay = (slow.start * _EVERY - first) * _FAST
            grids.append(Grid(delay, _SLOW, slow.start, len(slow), 1.0))
        encoded = []
        for number, each in enumerate(patches):
            grid = int(each.period == _SLOW)
            if grid == len(grids):
                continue
            begin, count = grids[grid].first_row, grids[grid].rows
            values = each.values[begin : begin + count]
            encoded.append(
                PatchSamples.pack(
                    values, each.least_width, patch=number, grid=grid, first_row=begin
                )
            )
            total["samples"] += values.size
            total["codes"] += len(encoded[-1].samples.codes)
            for encoding in (Encoding.Q16, Encoding.F32):
                total[encoding.name] += sum(
                    _block(each, values[:, k], encoding) for k in range(values.shape[1])
                )
        place = Position(1, 100_000 + first)
        frame = Frame(place, bytes(32), 0, first * _FAST, _START, tuple(grids), tuple(encoded))
        total["frame"] += len(frame.encode())
    return {name: count / total["samples"] for name, count in total.items() if name != "samples"}


def _block(patch: Measured, values: Interval, encoding: Encoding) -> int:
    tube = Tube(_START, patch.period, values, patch.unit, 1.0)
    block = Block.pack(Position(1, 100_000), "t00.capacitance", _BILLION, tube, encoding)
    return len(block.encode())


def speeds(pressure: Measured, rows: int) -> dict[str, float]:
    """Samples a second that are encoded and decoded, a patch at a time."""
    wide = Interval.concatenate([pressure.values] * 5, axis=1)[:, :_COLUMNS]
    matrices = [wide[k : k + rows] for k in range(0, 1000 // rows * rows, rows)]
    sampling, width = Sampling(rows, _COLUMNS), pressure.least_width
    encoded = [encode_samples(each, sampling, width) for each in matrices]
    cells, finest = firmware.Sampling(rows, _COLUMNS), firmware.finest_exponent(width)
    lists = [(each.inf.ravel().tolist(), each.sup.ravel().tolist()) for each in matrices]
    ways: dict[str, Callable[[], object]] = {
        "encode": lambda: [encode_samples(each, sampling, width) for each in matrices],
        "decode": lambda: [decode_samples(each, sampling) for each in encoded],
        "plain": lambda: [firmware.encode_samples(lo, hi, cells, finest) for lo, hi in lists],
    }
    samples = len(matrices) * rows * _COLUMNS
    return {
        name: samples / min(_seconds(way) for _ in range(_REPEATS)) for name, way in ways.items()
    }


def _seconds(way: Callable[[], object]) -> float:
    way()
    begin = time.process_time()
    way()
    return time.process_time() - begin


def main() -> None:
    """Print two tables."""
    with tempfile.TemporaryDirectory() as folder:
        patches = measure(Path(folder))
    channels = sum(each.values.shape[1] for each in patches)
    print(f"bytes a sample, {channels} channels in {len(patches)} patches")
    for rows in _ROWS:
        found = sizes(patches, rows)
        print(f"{rows:4} rows", *(f"{name} {size:.2f}" for name, size in found.items()), sep="  ")
    pressure = next(each for each in patches if each.unit == "Pa")
    print(f"million samples a second of CPU, {_COLUMNS} columns")
    for rows in _ROWS:
        rates = speeds(pressure, rows)
        print(f"{rows:4} rows", *(f"{n} {rate / 1e6:.2f}" for n, rate in rates.items()), sep="  ")


if __name__ == "__main__":
    main()
