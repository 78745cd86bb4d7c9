"""From the sample to the store and to the event stream, in a running demo."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from contextlib import closing
from typing import TYPE_CHECKING

import httpx
import numpy as np

from benchmarks.report import Row
from eskin.wire.timestamp import parse_timestamp
from tests.support.demos import RunningDemo

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_NODES = ("fingertip", "palm", "forearm")


def measure_latency(data: Path, *, seconds: float) -> list[Row]:
    """p50 and p99, in ms, over all samples and over the last sample of each frame."""
    with RunningDemo(data, "--nodes", "3") as demo:
        demo.wait_for_more(_NODES)
        begin = time.time_ns()
        received_messages = _listen(demo, seconds)
        stored = _stored(data, begin)
    return [
        *_rows("sample to stored", stored),
        *_rows("sample to event stream", received_messages),
    ]


def _listen(demo: RunningDemo, seconds: float) -> NDArray[np.int64]:
    """(first sample, last sample, arrival) of each frame on the event stream, ns."""
    found: list[tuple[int, int, int]] = []
    access = demo.access
    headers = {"Authorization": f"Bearer {access['token']}"}
    done = threading.Event()
    timer = threading.Timer(seconds, done.set)
    timer.start()
    url = f"{access['url']}/api/v1/live"
    with httpx.stream("GET", url, headers=headers, timeout=30) as answer:
        event = ""
        for line in answer.iter_lines():
            if line.startswith("event:"):
                event = line[6:].strip()
            elif line.startswith("data:") and event == "frame":
                received_message = time.time_ns()
                frame = json.loads(line[5:])
                first = parse_timestamp(frame["t0"])
                lasting = max(
                    each["t"] + each["dt"] - each["dt"] // each["n"] for each in frame["patches"]
                )
                found.append((first, first + lasting, received_message))
            if done.is_set():
                break
    return np.array(found, dtype=np.int64)


def _stored(data: Path, begin: int) -> NDArray[np.int64]:
    """(first sample, last sample, commit) of each frame in the store, ns."""
    path = data / "cloud" / "store.sqlite"
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        rows = db.execute("SELECT t, t_end, received FROM frames WHERE t >= ?", (begin,)).fetchall()
    return np.array(rows, dtype=np.int64)


def _rows(name: str, frames: NDArray[np.int64]) -> Sequence[Row]:
    first, last, received_message = frames.T
    # All samples of a frame are evenly spread between its first and its last.
    shares = np.linspace(0.0, 1.0, 101)
    every = (received_message[:, None] - (first[:, None] + shares * (last - first)[:, None])) / 1e6
    newest = (received_message - last) / 1e6
    return [
        Row(f"{name}, {which}, p{q}", float(np.percentile(values, q)), "ms")
        for which, values in (("every sample", every), ("frame's last sample", newest))
        for q in (50, 99)
    ]
