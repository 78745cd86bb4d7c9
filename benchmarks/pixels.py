"""From the sample to the pixel: a real browser watches a running demo.

``python -m benchmarks.pixels`` alone, or with the rest in ``make bench``. A sample is
painted once the frame that reaches it has been handed to the compositor.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.report import Row, at_most
from tests.support.demos import RunningDemo
from tests.unit.dashboard.browsing import launch, visiting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.unit.dashboard.browsing import Visit

_NODES: Final = ("fingertip", "palm", "forearm")
_HALF_MS: Final = 100.0
_MOST_MS: Final = 250.0

_WATCH: Final = """
(seconds) => new Promise((done) => {
  const charts = [...document.querySelectorAll("[data-testid=chart]")].filter((one) =>
    one.getBoundingClientRect().top < innerHeight && one.dataset.newest);
  const found = charts.map(() => []);
  const begin = performance.now();
  const look = () => {
    const now = performance.timeOrigin + performance.now();
    charts.forEach(({ dataset }, i) => {
      if (dataset.newest !== found[i].at(-1)?.[1]) found[i].push([now, dataset.newest]);
    });
    if (performance.now() - begin > 1000 * seconds) done(found);
    else requestAnimationFrame(frame);
  };
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = look;
  const frame = () => port2.postMessage(null);
  requestAnimationFrame(frame);
})
"""
"""For each chart: when (ms since 1970) which instant (ns since 1970) was the newest one painted."""


def measure_pixels(data: Path, *, seconds: float) -> list[Row]:
    """p50 and p99 over all samples of all channels that are seen."""
    with RunningDemo(data, "--nodes", "3") as demo, sync_playwright() as playwright:
        demo.wait_for_more(_NODES)
        browser = launch(playwright)
        size = {"width": 1280, "height": 900}
        with visiting(browser, demo.access["url"], viewport=size) as visit:
            visit.page.goto(demo.login_url)
            visit.wait_for_chart(mode="live")
            visit.page.wait_for_timeout(5000)
            found = _watch(visit, seconds)
        browser.close()
    ages = np.concatenate([_ages(frames) for frames in found])
    name = f"sample to pixel, {len(found)} channels of the demo"
    return [
        at_most(f"{name}, p{q}", float(np.percentile(ages, q)), "ms", most)
        for q, most in ((50, _HALF_MS), (99, _MOST_MS))
    ]


def _watch(visit: Visit, seconds: float) -> list[list[tuple[float, int]]]:
    found = visit.evaluate(_WATCH, seconds)
    return [[(at, int(newest)) for at, newest in frames] for frames in found]


def _ages(frames: Sequence[tuple[float, int]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """How old each sample (one a ms) was when the first frame showed it, in ms."""
    ages = [np.zeros(0)]
    for (_, before), (at, newest) in pairwise(frames):
        samples = np.arange(before, newest, 1_000_000) + 1_000_000
        ages.append(at - samples / 1e6)
    return np.concatenate(ages)


def main() -> None:
    """Measure, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pixels", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-px-") as folder:
        rows = measure_pixels(Path(folder) / "demo", seconds=options.seconds)
    for row in rows:
        met = "" if row.met is None else " (met)" if row.met else " (NOT met)"
        print(f"{row.name}: {row.value:.4g} {row.unit}{met}")


if __name__ == "__main__":
    main()
