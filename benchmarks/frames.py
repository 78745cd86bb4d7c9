"""Bytes of nodes' frames, and the codec's speed: `python -m benchmarks.frames`.

Runs the packaged profiles' firmware as fast as it goes, with their stretch and with one of 3 rows.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_sensor_node.firmware import sample_codec as firmware
from eskin_sensor_node.firmware.message_writer import FRAME
from eskin_sensor_node.node.offline import offline_node
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings

from eskin.interval import Interval
from eskin.wire.frames import Frame, Sampling, decode_samples, encode_samples

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.machine.node_layout import NodeLayout

_SECONDS: Final = 2
_BILLION: Final = 1_000_000_000
_PROFILES: Final = ("fingertip", "palm", "forearm", "hand", "sole", "sock")
_FEW: Final = 3
_ROWS: Final = (3, 12, 125)
_COLUMNS: Final = 64
_REPEATS: Final = 5


def write_frames(
    folder: Path, profile: str, *, stretch: float | None = None, seconds: float = _SECONDS
) -> tuple[NodeSettings, NodeLayout, list[StoredMessage]]:
    """Run a profile's firmware, and return the frames that it writes.

    Args:
        folder: Keeps flash and truth.
        profile: A packaged one.
        stretch: ms; by default the profile's.
        seconds: How long; at least two stretches.
    """
    given: dict[str, Any] = {
        "node": {"name": profile, "profile": profile, "seed": 7},
        "identity": {"directory": folder, "site": folder},
        "flash": {"path": folder / "flash", "capacity_bytes": 2**30},
        "truth": {"path": folder / "truth", "limit_bytes": 2**31},
    }
    if stretch is not None:
        # So short a stretch is only measured: a processor may be too slow for it.
        given |= {"sampling": {"stretch_ms": stretch}, "machine": {"clock_hz": 10**10}}
    settings = NodeSettings(**given)
    seconds = max(seconds, 2 * settings.sampling.stretch_ms / 1000.0)
    with offline_node(settings) as offline:
        offline.run_until(round(seconds * _BILLION) + 1)
        kept = offline.flash.after((-1, -1), 1_000_000)
        return settings, offline.layout, [each for each in kept if each.kind == FRAME]


def sizes(folder: Path, profile: str, stretch: float | None) -> list[float]:
    """Milliseconds of a stretch, rows of the fastest taxel, and bytes a sample: frames, codes."""
    settings, _, written = write_frames(folder, profile, stretch=stretch)
    fastest = max(taxel.sampling for taxel in settings.taxel if taxel.burst is None)
    samples = sum(each.samples for each in written)
    codes = sum(len(p.samples.codes) for f in written for p in Frame.decode(f.body).patches)
    rows = settings.sampling.stretch_ms * fastest / 1000.0
    frames = sum(len(each.body) for each in written)
    return [settings.sampling.stretch_ms, rows, frames / samples, codes / samples]


def speeds(rows: int) -> dict[str, float]:
    """Samples a second that are encoded and decoded, a patch at a time."""
    random, width = np.random.default_rng(7), 600.0
    middle = 1e4 + np.cumsum(random.normal(scale=20.0, size=(1000, _COLUMNS)), axis=0)
    wide = Interval(middle - 0.6 * width, middle + 0.6 * width)
    matrices = [wide[k : k + rows] for k in range(0, 1000 // rows * rows, rows)]
    sampling = Sampling(rows, _COLUMNS)
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


def shorten(profile: str, rows: int) -> float:
    """The stretch in which the profile's fastest taxel is sampled so often, ms."""
    # Bursts are far faster than any stretch can be short.
    taxels = [each for each in Profile.read(profile).taxels if "burst_s" not in each]
    return 1000.0 * rows / max(float(each.get("sampling_Hz", 0.0)) for each in taxels)


def main() -> None:
    """Print two tables."""
    print("profile     stretch_ms  rows  bytes a sample: frames  codes")
    for profile in _PROFILES:
        for rows in (None, _FEW):
            with tempfile.TemporaryDirectory() as folder:
                stretch = None if rows is None else shorten(profile, rows)
                found = sizes(Path(folder), profile, stretch)
            print(f"{profile:10}", *(f"{each:10.2f}" for each in found))
    print(f"million samples a second of CPU, {_COLUMNS} columns")
    for rows in _ROWS:
        rates = speeds(rows)
        print(f"{rows:4} rows", *(f"{n} {rate / 1e6:.2f}" for n, rate in rates.items()), sep="  ")


if __name__ == "__main__":
    main()
