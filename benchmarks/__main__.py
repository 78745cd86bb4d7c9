"""``python -m benchmarks``: run all, print the table, write ``build/bench.json``."""

from __future__ import annotations

import argparse
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from benchmarks.columns import measure_columns
from benchmarks.contacts import measure_contacts
from benchmarks.dashboard import measure_dashboard
from benchmarks.envelope import measure_envelope
from benchmarks.fleet import measure_emulation, measure_fleet
from benchmarks.frame_viewers import measure_frame_viewers
from benchmarks.gateway import measure_gateway
from benchmarks.gateway_frames import measure_gateway_frames
from benchmarks.icm import measure_icm
from benchmarks.ingest import measure_ingest
from benchmarks.latency import measure_latency
from benchmarks.live_monitors import measure_live_monitors
from benchmarks.models import measure_models
from benchmarks.monitors import measure_monitors
from benchmarks.patch_rows import measure_bytes
from benchmarks.peaks import measure_peaks
from benchmarks.pipeline import measure_pipeline
from benchmarks.pixels import measure_pixels
from benchmarks.pyramid import measure_pyramid
from benchmarks.reflexes import measure_reflexes
from benchmarks.report import Row, as_table, write_json
from benchmarks.shared_errors import measure_shared_errors
from benchmarks.skin import HAND, measure_skin
from benchmarks.skin_reads import measure_skin_reads
from benchmarks.storage import measure_storage
from tests.support.processes import unwound_by_signals

if TYPE_CHECKING:
    from collections.abc import Iterator


def main() -> None:
    """Measure what is asked for, everything by default."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--frames", type=int, default=20_000, help="frames through the gateway")
    parser.add_argument("--seconds", type=float, default=30.0, help="seconds of the running demo")
    parser.add_argument("--nodes", type=int, default=2000, help="nodes of a fleet over the network")
    parser.add_argument("--skin-seconds", type=int, default=600, help="of a large skin, to read")
    options = parser.parse_args()
    console = Console()
    if not console.is_terminal:
        console = Console(width=140)
    rows: list[Row] = []
    with _step(console, "models against plain numpy and other interval libraries"):
        rows += measure_models()
        rows += measure_icm()
    with _step(console, "peaks of a tube against scipy's find_peaks"):
        rows += measure_peaks()
    with _step(console, "monitors against rtamt's"):
        rows += measure_monitors()
    # It shows its own progress.
    rows += measure_reflexes()
    with _step(console, "differences with shared errors"):
        rows += measure_shared_errors()
    with unwound_by_signals(), tempfile.TemporaryDirectory(prefix="eskin-bench-") as folder:
        data = Path(folder)
        with _step(console, "ten thousand monitors of the cloud"):
            rows += measure_live_monitors(data / "monitors", monitors=10_000)
        with _step(console, "sealing and opening envelopes"):
            rows += measure_envelope()
        with _step(console, f"{options.frames} frames through broker, gateway and cloud"):
            rows += measure_pipeline(data / "pipeline", frames=options.frames)
        with _step(console, "the gateway beside a plain paho relay"):
            rows += measure_gateway(data / "gateway", frames=6000)
        with _step(console, "frames into both stores and over HTTPS"):
            rows += measure_ingest(data / "ingest")
        with _step(console, f"{options.nodes} nodes of a fleet over the network"):
            rows += measure_fleet(data / "fleet", nodes=options.nodes, seconds=15.0)
        with _step(console, "physics and firmware of 10000 nodes"):
            rows += measure_emulation(data, nodes=10_000)
        with _step(console, f"latency in a demo of {options.seconds:g} s"):
            rows += measure_latency(data / "demo", seconds=options.seconds)
        with _step(console, "from the sample to the pixel in a browser"):
            rows += measure_pixels(data / "pixels", seconds=options.seconds)
        rows += _measure_skin(data, console, reads=options.skin_seconds, seconds=options.seconds)
        # It shows its own progress.
        rows += measure_pyramid(
            {size: data / f"{size}.sqlite" for size in (10**6, 10**8)},
            data / "asked",
            questions=300,
        )
        with _step(console, "what the demo's samples take of the disk"):
            rows += measure_storage(data / "disk", seconds=2 * options.seconds)
        with _step(console, "the dashboard's frames, and its pictures of months"):
            rows += measure_dashboard(data / "stage", seconds=20.0, samples=30_000_000)
    console.print(as_table(rows))
    write_json(rows, Path("build/bench.json"))


@contextmanager
def _step(console: Console, what: str) -> Iterator[None]:
    """Print what is measured, and how long it took: also to a file, where no spinner turns."""
    console.print(f"{what} …")
    begun = time.monotonic()
    yield
    console.print(f"  {time.monotonic() - begun:.0f} s")


def _measure_skin(folder: Path, console: Console, *, reads: int, seconds: float) -> list[Row]:
    """A large skin: each of its parts, then all of them in real time."""
    rows: list[Row] = []
    with _step(console, "a large skin in columns"):
        rows += measure_columns()
    with _step(console, "contacts of a large skin"):
        rows += measure_contacts()
    with _step(console, "bytes of the hand's samples"):
        rows += measure_bytes(folder / "hand")
    with _step(console, "CPU of the gateway a frame"):
        rows += measure_gateway_frames()
    with _step(console, f"one channel and pictures of {reads} s of a large skin"):
        rows += measure_skin_reads(folder / "reads", seconds=reads)
    with _step(console, "frames of 8,400 taxels to 50 viewers"):
        rows += measure_frame_viewers(folder / "watched", seconds=seconds)
    say = console.print
    rows += measure_skin(folder / "demo", skin=HAND, seconds=seconds, viewers=3, say=say)
    for rate in (50.0, 100.0):
        rows += measure_skin(folder / f"skin-{rate:g}", rate=rate, seconds=seconds, say=say)
    return rows


main()
