"""``python -m benchmarks.soak``: memory of broker, gateway and cloud under a steady load.

One node sends frames at a fixed rate over TLS, never with more than a window unacknowledged. Beside
it a skin of 336 taxels sends frames, which a viewer and a page watch. In the end every frame that
was acknowledged must be in the cloud's store. Writes ``build/soak.json``.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from benchmarks.flood import Flood
from benchmarks.trend import LEAST, Trend
from eskin.identity import IdentityKind
from eskin.identity.identity import CHAIN_FILE
from tests.support.files import ask, write_settings
from tests.support.processes import ESKIN, Running, unwound_by_signals, wait_until
from tests.support.skin_watcher import Seen
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_WINDOW: Final = 4000
_AT_ONCE: Final = 100
_SAMPLES: Final = 600
"""Most samples of memory; at least one a second where there is time for it."""
_REST_S: Final = 30.0
"""A cloud gives memory back within 10 s of the last load, a gateway a little later."""
_STRETCHES: Final = 60
SKIN: Final = "small-hand"
_TRUTH_BYTES: Final = 1 << 28
_FRAMES: Final = "SELECT count(*) FROM frames"
_KEPT: Final = 0.99
"""Share of the rate that must be reached; the end's last acknowledgements count as time."""


def main() -> None:
    """Run, print, write; exit 1 unless memory is flat under that load, and no frame is missing."""
    parser = argparse.ArgumentParser(prog="make soak", description=__doc__)
    parser.add_argument("--duration", type=float, default=3600.0, help="seconds of load")
    parser.add_argument("--rate", type=float, default=1000.0, help="frames a second")
    options = parser.parse_args()
    console = Console()
    with unwound_by_signals(), tempfile.TemporaryDirectory(prefix="eskin-soak-") as folder:
        said = f"{options.rate:g} frames/s for {options.duration:g} s …"
        with console.status(said):
            found = soak(Path(folder) / "stack", duration=options.duration, rate=options.rate)
    console.print(_table(found))
    target = Path("build/soak.json")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(found, indent=2) + "\n")
    flat = all(part["verdict"] == "flat" for part in found["processes"].values())
    kept = found["rate"] >= _KEPT * options.rate
    if not kept:
        console.print(f"[red]not the load that was asked for: {found['rate']:.0f} frames/s")
    if not found["frames"] or not found["pages"] or found["wrong"]:
        console.print(f"[red]the skin was not seen as it is: {found['wrong']}")
        kept = False
    sys.exit(0 if flat and kept and not found["missing"] else 1)


def soak(folder: Path, *, duration: float, rate: float, rest: float = _REST_S) -> dict[str, Any]:
    """Load the real stack.

    Args:
        folder: Takes all data.
        duration: Seconds.
        rate: Frames a second.
        rest: Seconds between the load and the last look at the memory.

    Returns:
        ``sent``, ``missing``, the rate reached, what the skin's watcher saw (``frames``, ``pages``,
        ``wrong``), and for each process its memory in bytes before,
        under (also as medians of stretches of time) and after the load, the growth an hour as an
        interval, and the verdict.
    """
    with (
        RealStack(folder) as stack,
        _skin(stack) as seen,
        Flood(stack.pki, stack.broker.node_port) as flood,
    ):
        parts = {"broker": stack.broker, "gateway": stack.gateway, "cloud": stack.cloud}
        flood.introduce()
        idle = memory(parts)
        begun = time.monotonic()
        seconds, samples, sent = _load(flood, parts, duration=duration, rate=rate)
        flood.wait_for(sent)
        took = time.monotonic() - begun
        missing = _missing(flood, stack, sent)
        time.sleep(rest)
        after = memory(parts)
        watched = Seen.read(seen)
    return {
        "sent": sent,
        "missing": missing,
        "rate": sent / took,
        "frames": len(watched.frames),
        "pages": watched.pages,
        "wrong": watched.wrong,
        "processes": {
            name: _process(seconds, [each[name] for each in samples], idle[name], after[name])
            for name in parts
        },
    }


@contextmanager
def _skin(stack: RealStack) -> Iterator[Path]:
    """A node of 336 taxels, and what watches it; gives the file of what was seen."""
    folder, seen = stack.folder / SKIN, stack.folder / "seen"
    own = stack.identities.make(IdentityKind.NODE, SKIN)
    folder.mkdir()
    config = write_settings(folder / "node.toml", {
        "node": {"name": SKIN, "profile": SKIN, "seed": 1},
        "broker": {"host": "127.0.0.1", "port": stack.broker.node_port},
        "identity": {"directory": own.directory, "site": stack.pki / "site.main" / CHAIN_FILE},
        "flash": {"path": folder / "flash.sqlite"},
        "truth": {"path": folder / "truth.sqlite", "limit_bytes": _TRUTH_BYTES},
    })  # fmt: skip
    node = Running([ESKIN, "node", "--config", str(config)], log=folder / "log")
    with stack.operator() as client:
        port, token = client.base_url.port, client.headers["Authorization"].split()[1]
    words = ["-m", "tests.support.skin_watcher", str(port), SKIN, str(seen)]
    watcher = Running(
        [sys.executable, *words], log=folder / "watcher.log", env={"ESKIN_TOKEN": token}
    )
    with node:
        node.wait_for(lambda: ask(stack.store, _FRAMES)[0][0] > 0, "a frame is stored")
        watcher.start()
        try:
            watcher.wait_for(seen.exists, "a frame is seen")
            yield seen
        finally:
            watcher.kill()


def memory(parts: Mapping[str, Running]) -> dict[str, int]:
    """Resident bytes of processes."""
    found = {}
    for name, part in parts.items():
        assert part.process is not None
        found[name] = int(psutil.Process(part.process.pid).memory_info().rss)
    return found


def _load(
    flood: Flood, parts: Mapping[str, Running], *, duration: float, rate: float
) -> tuple[list[float], list[dict[str, int]], int]:
    """Send at the rate; a window that is full waits. Gives samples, and how many were sent."""
    period = max(duration / _SAMPLES, min(1.0, duration / 200))
    begun = time.monotonic()
    seconds: list[float] = []
    samples: list[dict[str, int]] = []
    sent = 0
    while (now := time.monotonic() - begun) < duration or len(seconds) < LEAST:
        due = min(int(now * rate), flood.durable + _WINDOW, sent + _AT_ONCE)
        while sent < due:
            sent += 1
            flood.send(flood.seal_one(sent))
        if now >= len(seconds) * period:
            seconds.append(now)
            samples.append(memory(parts))
        time.sleep(0.002)
    return seconds, samples, sent


def _missing(flood: Flood, stack: RealStack, sent: int) -> int:
    """How many acknowledged frames the store lacks, once it has had time to get them."""
    try:
        wait_until(lambda: flood.stored(stack.store) >= sent, "all frames stored", seconds=120)
    except AssertionError:
        return sent - flood.stored(stack.store)
    return 0


def _process(seconds: list[float], used: list[int], idle: int, after: int) -> dict[str, Any]:
    trend = Trend.of(seconds, used)
    stretches = np.array_split(used, min(_STRETCHES, len(used)))
    return {
        "idle": idle,
        "mean": trend.mean,
        "most": max(used),
        "after": after,
        "growth_an_hour": [trend.lo, trend.hi],
        "stretches": [int(np.median(part)) for part in stretches],
        "verdict": trend.verdict,
    }


def _table(found: Mapping[str, Any]) -> Table:
    table = Table(
        title=f"soak: {found['sent']} frames at {found['rate']:.0f}/s, {found['missing']} missing; "
        f"{found['frames']} frames were seen"
    )
    for heading in ("process", "idle MB", "mean", "most", "after", "growth an hour", "verdict"):
        table.add_column(heading, justify="right")
    for name, part in found["processes"].items():
        lo, hi = part["growth_an_hour"]
        sizes = (f"{part[key] / 1e6:.1f}" for key in ("idle", "mean", "most", "after"))
        table.add_row(name, *sizes, f"{lo:+.1%} to {hi:+.1%}", part["verdict"])
    return table


if __name__ == "__main__":
    main()
