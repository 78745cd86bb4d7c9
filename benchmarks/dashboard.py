"""The dashboard in a real browser: frames, pictures of the past, bytes.

``python -m benchmarks.dashboard`` alone, or with the rest in ``make bench``. The browser paints
without a graphics processor, beside the cloud and what feeds it, on the same cores.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from eskin_cloud.service import DASHBOARD
from playwright.sync_api import sync_playwright

from benchmarks.report import Row, at_most
from benchmarks.stage import LIVE, Stage
from tests.unit.cloud.messages import CHANNEL, NODE, START
from tests.unit.dashboard.browsing import CHART, Visit, history, launch, visiting

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser

_CHANNELS: Final = 20
_FRAME_MS: Final = 1000 / 60
_PICTURE_MS: Final = 100.0
_SCRIPT_KB: Final = 150.0
_DAY: Final = 86_400 * 10**9
_DT: Final = 250_000_000

_FRAMES: Final = """
(seconds) => new Promise((done) => {
  const charts = [...document.querySelectorAll("[data-testid=chart]")];
  const begin = performance.now();
  const last = charts.map((chart) => chart.dataset.xMin);
  const moves = charts.map(() => 0);
  const at = [];
  const tick = (now) => {
    at.push(now);
    charts.forEach((chart, i) => {
      if (chart.dataset.xMin !== last[i]) moves[i] += 1;
      last[i] = chart.dataset.xMin;
    });
    if (now - begin < 1000 * seconds) requestAnimationFrame(tick);
    else done({ at, moves });
  };
  requestAnimationFrame(tick);
})
"""
"""When each frame began, in ms, and in how many of them each chart had moved."""

_WATCH: Final = """
() => {
  const panel = document.querySelector("[data-testid=channel]");
  const chart = panel.querySelector("[data-testid=chart]");
  const painted = (then) => requestAnimationFrame(() => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => then(performance.now());
    port2.postMessage(null);
  });
  window.begin = () => {
    const found = { moved: null, full: null };
    const start = { at: null, window: chart.dataset.xMin + chart.dataset.xMax };
    const onInput = (event) => { start.at ??= event.timeStamp; };
    const once = { capture: true, once: true };
    for (const kind of ["wheel", "keydown"]) addEventListener(kind, onInput, once);
    window.found = new Promise((done) => {
      const look = () => {
        const moved = chart.dataset.xMin + chart.dataset.xMax !== start.window;
        if (moved && found.moved === null) {
          found.moved = 0;
          painted((now) => { found.moved = now - start.at; });
        }
        if (moved && !panel.classList.contains("busy")) {
          watcher.disconnect();
          painted((now) => { found.full = now - start.at; done(found); });
        }
      };
      const watcher = new MutationObserver(look);
      watcher.observe(panel, { attributes: true, subtree: true });
    });
  };
}
"""
"""From a gesture to the first frame with the window moved, and to the one with all it asked for."""


def measure_dashboard(folder: Path, *, seconds: float, samples: int) -> list[Row]:
    """Frames of 20 live channels, gestures over months, bytes and time of the first picture."""
    rows = [measure_script()]
    with Stage(folder, live=_CHANNELS, stored=samples, dt=_DT) as stage, _browser() as browser:
        rows += _first_picture(browser, stage)
        rows += _frames(browser, stage, seconds)
        rows += _gestures(browser, stage, samples)
    return rows


@contextmanager
def _browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        running = launch(playwright)
        yield running
        running.close()


@contextmanager
def _visit(browser: Browser, stage: Stage, width: int, height: int) -> Iterator[Visit]:
    headers = {"Authorization": f"Bearer {stage.token}"}
    size: Any = {"width": width, "height": height}
    with visiting(browser, stage.url, viewport=size, extra_http_headers=headers) as visit:
        yield visit
        assert visit.troubles == [], visit.troubles


def measure_script() -> Row:
    """How much JavaScript a browser loads, gzipped."""
    total = sum(len(gzip.compress(file.read_bytes())) for file in DASHBOARD.rglob("*.js")) / 1e3
    return at_most("dashboard: JavaScript, gzipped", total, "kB", _SCRIPT_KB)


def _first_picture(browser: Browser, stage: Stage) -> Iterator[Row]:
    """Of a browser that has nothing of it yet: cold each time."""
    took = []
    for _ in range(5):
        with _visit(browser, stage, 1280, 900) as visit:
            visit.open(LIVE)
            visit.wait_for_chart(mode="live")
            took.append(visit.evaluate("performance.now()"))
    yield Row("dashboard: from address to the first chart, cold", float(np.median(took)), "ms")


def _frames(browser: Browser, stage: Stage, seconds: float) -> Iterator[Row]:
    with _visit(browser, stage, 1920, 1400) as visit:
        visit.open(f"{LIVE}?live=10s")
        visit.wait_for_chart(mode="live")
        shown = visit.evaluate(
            "() => [...document.querySelectorAll('[data-testid=chart]')].filter((one) =>"
            " one.getBoundingClientRect().top < innerHeight).length"
        )
        visit.page.wait_for_timeout(3000)
        with _thread_seconds(visit) as spent:
            found = visit.evaluate(_FRAMES, seconds)
    name = f"dashboard: {shown} live channels"
    steps = np.diff(np.array(found["at"]))
    moves = float(np.median(found["moves"])) / (found["at"][-1] - found["at"][0]) * 1e3
    rate = 1e3 / float(steps.mean())
    yield Row(f"{name}, frames", rate, "1/s", target=60.0, met=rate >= 59.0)
    yield Row(f"{name}, frames in which a chart moves", moves, "1/s", target=60.0, met=moves >= 59)
    busy = spent[0] / max(found["moves"]) * 1e3
    yield at_most(f"{name}, processor of the page's thread a picture", busy, "ms", _FRAME_MS)
    late = float((steps > 1.5 * _FRAME_MS).mean()) * 100
    yield at_most(f"{name}, frames late by half or more", late, "%", 1.0)


@contextmanager
def _thread_seconds(visit: Visit) -> Iterator[list[float]]:
    """What the page's main thread spends on the processor meanwhile, whatever else uses it."""
    session = visit.page.context.new_cdp_session(visit.page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    spent: list[float] = []

    def read() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))

    before = read()
    yield spent
    spent.append(read() - before)
    session.detach()


def _gestures(browser: Browser, stage: Stage, samples: int) -> Iterator[Row]:
    span = samples * _DT
    with _visit(browser, stage, 1280, 900) as visit:
        visit.open(history(f"{NODE}/{CHANNEL}", START, START + span))
        visit.wait_for_chart(mode="history", resolution="hull")
        visit.page.locator(CHART).focus()
        visit.evaluate(_WATCH)
        box = visit.page.locator(CHART).bounding_box()
        assert box is not None
        visit.page.mouse.move(box["x"] + box["width"] * 0.4, box["y"] + box["height"] / 2)
        found = [_gesture(visit, kind) for kind in _ways()]
    months = span / _DAY
    name = f"dashboard: gesture over {months:.0f} days, {samples:.0e} samples"
    for key, what in (("moved", "moved picture"), ("full", "full picture")):
        took = np.array([one[key] for one in found])
        for q in (50, 99):
            yield at_most(f"{name}, {what}, p{q}", float(np.percentile(took, q)), "ms", _PICTURE_MS)


def _ways() -> Iterator[str]:
    """Down into single samples, about, and out again."""
    for _ in range(3):
        yield from ["in"] * 20
        yield from ["ArrowLeft", "ArrowRight", "ArrowRight"] * 3
        yield from ["out"] * 20
        yield from ["ArrowRight", "ArrowLeft"]


def _gesture(visit: Visit, kind: str) -> dict[str, float]:
    visit.evaluate("begin()")
    if kind in {"in", "out"}:
        visit.page.mouse.wheel(0, -400 if kind == "in" else 400)
    else:
        visit.page.keyboard.press(kind)
    found: dict[str, float] = visit.evaluate("() => window.found")
    return found


def main() -> None:
    """Measure, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.dashboard", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching frames")
    parser.add_argument("--samples", type=float, default=3e7, help="in the store")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-dashboard-") as folder:
        rows = measure_dashboard(
            Path(folder) / "stage", seconds=options.seconds, samples=int(options.samples)
        )
    for row in rows:
        met = "" if row.met is None else " (met)" if row.met else " (NOT met)"
        print(f"{row.name}: {row.value:.4g} {row.unit}{met}")


if __name__ == "__main__":
    main()
