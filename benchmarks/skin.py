"""A large skin in real time, from its physics to the pixel, through the whole stack.

``python -m benchmarks.skin --skin paper-hand --rate 50 --seconds 600`` runs a demo with that skin,
watches it in headless Chromium and, with ``--viewers``, over further WebSockets; then `eskin audit`
compares all that was stored with the truth. Its processes share the machine with the browser.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import subprocess
import tempfile
import threading
import time
from collections import Counter
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import psutil
from playwright.sync_api import sync_playwright

from benchmarks.frame_viewers import Viewer
from benchmarks.report import Row, at_least, at_most
from tests.support.demos import RunningDemo
from tests.support.processes import ESKIN, unwound_by_signals, wait_until
from tests.unit.dashboard.browsing import launch, visiting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from tests.unit.dashboard.browsing import Visit

SKIN: Final = "paper-hand"
HAND: Final = "hand"
"""The demo's own, of 83 channels: each at the rate of its profile."""
_HAND_HZ: Final = 250.0
"""Of its pads."""
_HALF_MS: Final = 150.0
_MOST_MS: Final = 300.0
_PICTURES: Final = 30.0
_RESTING_S: Final = 10.0
"""From the first picture to the measurement: the browser and the cloud compile meanwhile."""
_STEP_S: Final = 10.0
_POLLS: Final = 10
"""Of the lag, in a step."""
_VIEW: Final = "[data-testid=skin-view]"
_OVERRUN: Final = "sampling overrun"

_OBSERVE: Final = """
() => {
  window.seen = [];
  const take = (list) => window.seen.push(
    ...list.getEntriesByName("eskin.picture").map(({ detail }) => detail));
  new PerformanceObserver(take).observe({ type: "measure" });
}
"""
_TAKE: Final = "() => window.seen.splice(0)"


@dataclass
class Watched:
    """What was seen of a skin.

    Attributes:
        pictures: Newest sample (UTC ns) and time of painting (UTC ms) of each picture.
        lags: Polled: from the last sample of the latest frame to its storage, at most, ns.
        loads: Polled: the machine's load of one minute.
        used: Seconds of CPU by process and its id.
        spent: Seconds of CPU by process, of the measurement alone.
        seconds: How long it was.
    """

    pictures: list[tuple[int, float]] = field(default_factory=list)
    lags: list[int] = field(default_factory=list)
    loads: list[float] = field(default_factory=list)
    used: dict[tuple[str, int], float] = field(default_factory=dict)
    spent: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0


def measure_skin(
    data: Path,
    *,
    skin: str = SKIN,
    rate: float = 50.0,
    seconds: float = 600.0,
    viewers: int = 0,
    say: Callable[[str], None] = print,
) -> list[Row]:
    """Run a demo of a skin, and watch it.

    Args:
        data: Folder of the demo; made.
        skin: Its profile; `HAND`: the demo's four nodes, of which the hand is watched.
        rate: Samples of each taxel a second, Hz; not of the demo's hand.
        seconds: Of the measurement.
        viewers: WebSocket clients beside the browser.
        say: Takes a line of progress each 10 s, and at the end those of the audit.
    """
    rate = _HAND_HZ if skin == HAND else rate
    options = () if skin == HAND else ("--skin", skin)
    environment = {} if skin == HAND else {"ESKIN_SKIN_SAMPLING_HZ": repr(rate)}
    with RunningDemo(data, *options, env=environment) as demo:
        with _page(demo, skin) as visit:
            say(f"{skin} at {rate:g} Hz is shown; measuring for {seconds:g} s")
            visit.page.wait_for_timeout(1000 * _RESTING_S)
            with _looking(demo, skin, viewers, seconds) as clients:
                found = _watch(demo, visit, skin, seconds, say)
        gaps = demo.get("/events", node=skin, kind="gap", limit=1000)["items"]
        status = demo.stop(seconds=300)
    if status:
        say(f"the demo ended with {status}")
    for gap in gaps:
        say(f"gap: {gap['detail']}")
    passed, violations = _audit(data, say)
    name = f"{skin} at {rate:g} Hz"
    overruns = sum(str(gap["detail"]).startswith(_OVERRUN) for gap in gaps)
    return [
        *_pixel_rows(name, found, round(1e9 / rate)),
        at_most(f"{name}: gaps as real time was not held", overruns, "", 0.0),
        Row(f"{name}: gaps", len(gaps), ""),
        at_most(f"{name}: lag, p99", float(np.percentile(found.lags, 99)) / 1e6, "ms", _MOST_MS),
        *_cpu_rows(name, found),
        *_viewer_rows(name, clients, found.seconds),
        Row(f"{name}: load of the machine, mean", float(np.mean(found.loads)), ""),
        at_most(f"{name}: samples whose interval lacks the truth", violations, "", 0.0),
        at_least(f"{name}: audit passed", float(passed), "", 1.0),
    ]


@contextmanager
def _page(demo: RunningDemo, skin: str) -> Iterator[Visit]:
    """The dashboard of a demo, which has drawn its skin."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        size: Any = {"width": 1280, "height": 900}
        options: Any = {"viewport": size, "reduced_motion": "no-preference"}
        with visiting(browser, demo.access["url"], **options) as visit:
            visit.page.goto(demo.login_url)
            view = visit.page.locator(f"{_VIEW}[data-node={skin}]").first
            view.wait_for()
            wait_until(lambda: bool(view.get_attribute("data-newest")), "the skin is drawn")
            visit.evaluate(_OBSERVE)
            yield visit
            assert visit.troubles == [], visit.troubles
        browser.close()


@contextmanager
def _looking(demo: RunningDemo, skin: str, viewers: int, seconds: float) -> Iterator[list[Viewer]]:
    """WebSocket clients, in a thread of their own."""
    token, query = demo.access["token"], f"?node={skin}"
    clients = [Viewer(demo.port, token, query, timed=not k) for k in range(viewers)]

    async def look() -> None:
        await asyncio.gather(*(each.look(seconds) for each in clients))

    thread = threading.Thread(target=lambda: asyncio.run(look()), name="viewers")
    thread.start()
    try:
        yield clients
    finally:
        thread.join()


def _watch(
    demo: RunningDemo, visit: Visit, skin: str, seconds: float, say: Callable[[str], None]
) -> Watched:
    found, begun = Watched(), time.monotonic()
    visit.evaluate(_TAKE)
    _count_cpu(demo, found)
    found.spent.clear()
    with demo.client() as client:
        while (elapsed := time.monotonic() - begun) < seconds:
            step = min(_STEP_S, seconds - elapsed)
            for _ in range(_POLLS):
                visit.page.wait_for_timeout(1000 * step / _POLLS)
                node = client.get(f"/api/v1/nodes/{skin}").raise_for_status().json()
                found.lags.append(node["lag"]["hi_ns"])
            pictures = [
                (int(each["sample_ns"]), each["painted_ms"])
                for each in visit.evaluate(_TAKE)
                if each["node"] == skin
            ]
            found.pictures += pictures
            _count_cpu(demo, found)
            found.loads.append(os.getloadavg()[0])
            say(
                f"{time.monotonic() - begun:.0f} s: {len(pictures) / step:.0f} pictures a second, "
                f"p50 {_median_age(pictures):.0f} ms, lag {found.lags[-1] / 1e6:.0f} ms, "
                f"{node['gaps']} gaps, load {found.loads[-1]:.1f}"
            )
    found.seconds = time.monotonic() - begun
    return found


def _median_age(pictures: Sequence[tuple[int, float]]) -> float:
    return float(np.median([at - sample / 1e6 for sample, at in pictures] or [np.nan]))


def _count_cpu(demo: RunningDemo, found: Watched) -> None:
    """Add what each process used since the last call."""
    assert demo.process is not None
    own = psutil.Process()
    processes = [("benchmark", own), ("demo", psutil.Process(demo.process.pid))]
    stack = demo.children()
    processes += stack.items()
    others = {demo.process.pid, *(each.pid for each in stack.values())}
    processes += [
        ("browser", each) for each in own.children(recursive=True) if each.pid not in others
    ]
    for name, process in processes:
        with suppress(psutil.Error):  # it has just ended
            times = process.cpu_times()
            now = times.user + times.system
            found.spent[name] += now - found.used.get((name, process.pid), 0.0)  # type: ignore[assignment]  # of seconds
            found.used[name, process.pid] = now


def _pixel_rows(name: str, found: Watched, period: int) -> Iterator[Row]:
    """A sample is shown once a picture is painted that has it, or a later one."""
    ages, shown = [np.zeros(0)], 0
    for (before, _), (newest, at) in pairwise(found.pictures):
        samples = np.arange(newest, before, -period)
        ages.append(at - samples / 1e6)
        shown += newest > before
    every = np.concatenate(ages)
    for q, most in ((50, _HALF_MS), (99, _MOST_MS)):
        yield at_most(f"{name}: sample to pixel, p{q}", float(np.percentile(every, q)), "ms", most)
    rate = len(found.pictures) / found.seconds
    yield at_least(f"{name}: pictures a second", rate, "1/s", _PICTURES)
    yield Row(f"{name}: samples of the skin shown a second", shown / found.seconds, "1/s")


def _cpu_rows(name: str, found: Watched) -> Iterator[Row]:
    for process, spent in sorted(found.spent.items()):
        yield Row(f"{name}: processor of {process}", spent / found.seconds * 100, "% of a core")


def _viewer_rows(name: str, clients: Sequence[Viewer], seconds: float) -> Iterator[Row]:
    if not clients:
        return
    octets = float(np.mean([each.octets for each in clients]))
    yield Row(f"{name}: {len(clients)} viewers, a viewer", octets / seconds / 1e3, "kB/s")
    timed = clients[0]
    age = float(np.percentile(timed.ages, 99)) / 1e6
    yield Row(f"{name}: {len(clients)} viewers, stored to received, p99", age, "ms")
    yield Row(f"{name}: {len(clients)} viewers, frames one was not sent", timed.skipped, "")


def _audit(data: Path, say: Callable[[str], None]) -> tuple[bool, int]:
    """Whether `eskin audit` passes, and how many samples lack the truth."""
    say("eskin audit compares all samples with the truth")
    argv = [ESKIN, "audit", "--data", str(data)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    lines = (done.stdout + done.stderr).strip().splitlines()
    for line in lines[-5:]:
        say(line)
    violations = re.search(r"(\d+) samples, (\d+) violations", done.stdout)
    assert violations is not None, done.stdout + done.stderr
    return done.returncode == 0, int(violations[2])


def main() -> None:
    """Measure, and print a line a figure."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.skin", description=__doc__)
    parser.add_argument("--skin", default=SKIN, help="profile of the node")
    parser.add_argument("--rate", type=float, default=50.0, help="samples of each taxel a second")
    parser.add_argument("--seconds", type=float, default=600.0, help="of the measurement")
    parser.add_argument("--viewers", type=int, default=0, help="WebSocket clients besides")
    options = parser.parse_args()
    with unwound_by_signals(), tempfile.TemporaryDirectory(prefix="eskin-skin-") as folder:
        rows = measure_skin(
            Path(folder) / "demo",
            skin=options.skin,
            rate=options.rate,
            seconds=options.seconds,
            viewers=options.viewers,
            say=lambda line: print(line, flush=True),
        )
    for row in rows:
        met = "" if row.met is None else " (met)" if row.met else " (NOT met)"
        print(f"{row.name}: {row.value:.4g} {row.unit}{met}")


if __name__ == "__main__":
    main()
