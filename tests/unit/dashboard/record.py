"""Record what the demo's cloud answers, for tests of the dashboard that need no demo.

``python -m tests.unit.dashboard.record`` runs a demo for half a minute and writes ``RECORDING``.
Record again when an answer of the REST API has changed.
"""

from __future__ import annotations

import json
import lzma
import tempfile
from pathlib import Path
from typing import Any, Final

from eskin.wire.timestamp import parse_timestamp
from tests.support.demos import RunningDemo

RECORDING: Final = Path(__file__).with_name("recording.json.xz")
NODES: Final = ("fingertip", "palm", "forearm")
LENGTH_NS: Final = 5_000_000_000
"""Of the recorded series and events; `Replay` repeats them without end."""


def record(demo: RunningDemo) -> dict[str, Any]:
    """Answers of the cloud, and one stretch of all its series and events."""

    def ends() -> list[int]:
        channels = [c for node in NODES for c in demo.get(f"/nodes/{node}/channels")["items"]]
        return [parse_timestamp(one["last"]) for one in channels if one["last"]]

    begin = max(ends()) + 5_000_000_000
    start = begin - begin % 1_000_000_000
    window = {"start": start, "end": start + LENGTH_NS}
    demo.wait_for(lambda: min(ends()) > window["end"] + 1_000_000_000, "the window is stored")
    channels = {node: demo.get(f"/nodes/{node}/channels")["items"] for node in NODES}
    return {
        "start": start,
        "nodes": demo.get("/nodes")["items"],
        "gateways": demo.get("/gateways")["items"],
        "storage": demo.get("/storage"),
        "models": demo.get("/models")["items"],
        "channels": channels,
        "places": {node: _places(demo.get(f"/nodes/{node}/layout")) for node in NODES},
        "states": {node: demo.get(f"/nodes/{node}/state") for node in NODES},
        "series": {
            f"{node}/{channel['id']}": _rounded(
                demo.get(f"/series/{node}/{channel['id']}", points=20_000, **window)
            )
            for node in NODES
            for channel in channels[node]
        },
        "events": _events(demo, window),
    }


def _places(layout: dict[str, Any]) -> dict[str, list[float]]:
    """Where taxels are, in m."""
    return {
        taxel: list(at[:2])
        for patch in layout["patches"]
        for taxel, *at in zip(patch["taxels"], *patch["positions"], strict=True)
    }


def _rounded(series: dict[str, Any]) -> dict[str, Any]:
    """Bounds of five digits take half the room; what is on the page is compared with these."""
    assert series["resolution"] == "sample", "the window has more samples than points"
    bounds = {
        side: [None if one is None else float(f"{one:.5g}") for one in series[side]]
        for side in ("lo", "hi")
    }
    return {**series, **bounds}


def _events(demo: RunningDemo, window: dict[str, int]) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    cursor: dict[str, str] = {}
    while True:
        page = demo.get("/events", limit=500, **window, **cursor)
        found += page["items"]
        if page["next"] is None:
            return found
        cursor = {"cursor": page["next"]}


def main() -> None:
    """Write the recording."""
    with (
        tempfile.TemporaryDirectory() as folder,
        RunningDemo(Path(folder) / "data", "--nodes", "3") as demo,
    ):
        demo.wait_for_more(NODES)
        text = json.dumps(record(demo), separators=(",", ":"))
    RECORDING.write_bytes(lzma.compress(text.encode()))


if __name__ == "__main__":
    main()
