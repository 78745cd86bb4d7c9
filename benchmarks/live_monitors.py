"""Ten thousand monitors over frames that arrive: from the stored frame to the settled verdict.

``python -m benchmarks.live_monitors`` stores a second of frames of 157 nodes with 64 channels each,
at 50 Hz, and has the cloud's evaluator read them from the feed, with one monitor a channel. It
counts CPU seconds of that; ingest is not in it. `benchmarks.monitors` measures the monitors alone.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.alarms.evaluator import Evaluator
from eskin_cloud.live.feed import read_entries
from eskin_cloud.store import Store
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.feed_entry import FEED_START, last_position
from eskin_cloud.store.write.monitors import MonitorDefinition, put_monitor

from benchmarks.report import Row, at_most
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import START
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from sqlalchemy import Connection

CHANNELS: Final = 64
_RATE: Final = 50
_SECONDS: Final = 6
_MOST_CORES: Final = 0.5
FORMULA: Final = (
    "always[0,1280ms]({0} > 800 Pa implies eventually[0,1280ms] {0} < 200 Pa) and {0} < 3 kPa"
)
"""Three comparisons and two windows of 64 samples, as in `benchmarks.monitors`."""


def measure_live_monitors(folder: Path, *, monitors: int) -> list[Row]:
    """Cores that the evaluator takes, by how long the nodes' stretches are, in ms."""
    rows = []
    for stretch in (1000, 200):
        with Store(folder / f"{stretch}.sqlite") as store:
            cores = _cores(store, monitors, stretch)
        name = f"{monitors} live monitors at 50 Hz, stretches of {stretch} ms"
        rows.append(at_most(name, cores, "cores", _MOST_CORES))
    return rows


def _cores(store: Store, monitors: int, stretch: int) -> float:
    """Median of the CPU seconds for a second of samples, once the windows are full."""
    nodes = [f"n{k:03d}" for k in range(-(-monitors // CHANNELS))]
    patch = Patch("palm", "pressure", "Pa", tuple(f"t{k:02d}" for k in range(CHANNELS)), 64.0)
    layout = Layout((patch.content_hash,), (1,))
    for node in nodes:
        describe(store, layout, patch, node=node)
    store.write(lambda connection: _define(connection, nodes, monitors)).result(600)
    evaluator = Evaluator(store, silence=15 * SECOND, clock=lambda: START)
    spent, position = [], FEED_START
    for second in range(_SECONDS):
        for part in range(1000 // stretch):
            at = second * 1000 + part * stretch
            for node in nodes:
                put(store, _frame(layout, patch, at, stretch), node=node)
        with store.read() as connection:
            end = last_position(connection)
            entries = read_entries(connection, position.spans(end))
            layouts = {layout.content_hash: find_layout(connection, nodes[0], layout.content_hash)}
        position = end
        begun = time.process_time()
        evaluator.load()
        evaluator.evaluate(entries, layouts, position=position)
        while any(each.position is None for each in evaluator.all_monitors):
            evaluator.evaluate([], layouts, position=position)
        spent.append(time.process_time() - begun)
    return median(spent[-3:])


def _define(connection: Connection, nodes: list[str], monitors: int) -> None:
    for k in range(monitors):
        formula = FORMULA.format(f"t{k % CHANNELS:02d}.pressure")
        definition = MonitorDefinition(
            formula,
            nodes[k // CHANNELS],
            "certain",
            missing=False,
            severity="warning",
            clear_after=SECOND,
            escalate_after=None,
        )
        put_monitor(connection, f"m{k}", definition, now=START)


def _frame(layout: Layout, patch: Patch, at: int, stretch: int) -> Frame:
    """Touches of a second and a half, every two seconds, with noise."""
    rows, period = stretch * _RATE // 1000, SECOND // _RATE
    seconds = at / 1000 + np.arange(rows) / _RATE
    noise = np.random.default_rng(at).normal(size=(rows, CHANNELS))
    lo = 1000.0 * np.maximum(np.sin(np.pi * seconds), 0.0)[:, None] + 10.0 * noise
    instant = START + at * 1_000_000
    grid = Grid(0, period, at * _RATE // 1000, rows, 1.0)
    packed = PatchSamples.pack(
        Interval(lo, lo + 20.0), patch.least_width, patch=0, grid=0, first_row=grid.first_row
    )
    return Frame(
        *(Position(1, at), layout.content_hash, 0, at * 1_000_000, (instant, instant + 1000)),
        (grid,),
        (packed,),
    )


def _main() -> None:
    from rich.console import Console  # noqa: PLC0415 - for the command alone

    from benchmarks.report import as_table  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--monitors", type=int, default=10_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measure_live_monitors(Path(folder), monitors=options.monitors)
    Console(width=140).print(as_table(rows))


if __name__ == "__main__":
    _main()
