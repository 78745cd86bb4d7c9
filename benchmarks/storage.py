"""Bytes on disk for each sample of the demo's channels, once compacted, with pyramid and events.

``python -m benchmarks.storage`` measures it alone.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Final

from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.disk_usage import measure_disk

from benchmarks.report import Row
from tests.support.demos import RunningDemo

_MOST_BYTES: Final = 3.0
_SPEED: Final = 4.0
_DUE: Final = Due(2**62, 2**62)
"""Frames of any age are compacted."""


def measure_storage(data: Path, *, seconds: float) -> list[Row]:
    """What a demo leaves in its store that ran for so many seconds, at four times the pace."""
    with RunningDemo(data, "--nodes", "3", "--speed", str(_SPEED)):
        time.sleep(seconds)
    with Store(data / "cloud" / "store.sqlite") as store:
        came = measure_disk(store)
        for page in find_compactable_frames(store, _DUE):
            while compact_frames(store, page, _DUE):
                pass
        build(store)
        compacted = measure_disk(store)
    assert came.each is not None
    assert compacted.each is not None
    name = f"bytes on disk a sample, {compacted.samples / 1e6:.1f} M samples of the demo, compacted"
    ratio = came.each / compacted.each
    met = compacted.each <= _MOST_BYTES
    return [Row(name, compacted.each, "bytes", "as it came", came.each, ratio, None, met)]


def main() -> None:
    """Measure, and say so."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.storage", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-disk-") as folder:
        for row in measure_storage(Path(folder) / "demo", seconds=options.seconds):
            met = "met" if row.met else "NOT met"
            print(f"{row.name}: {row.value:.3g} ({row.peer}: {row.peer_value:.3g}; {met})")


if __name__ == "__main__":
    main()
