"""A cloud with two synthetic skins that are touched, so that the dashboard can be tested and seen.

``python -m tests.unit.dashboard.skin_cloud`` serves it on loopback. ``hand`` has 8,400 taxels at
50 Hz, ``glove`` the same shape with 21 taxels and two quantities. What they measure repeats every
`LOOP_NS`, in the past and live, so each answer can be computed again. Only what the dashboard asks
for is answered. `SkinCloud.mode` disturbs the live stream.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from eskin_sensor_node.world.skin.shapes import HandShape
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from eskin.contacts import Skin as ContactSkin
from eskin.contacts import find_contacts
from eskin.interval import Interval
from eskin.wire.frames import DescribedLayout, Frame, Grid, Layout, Patch, PatchSamples, Seam
from eskin.wire.messages import Position
from eskin.wire.timestamp import format_timestamp
from tests.unit.dashboard.frame_server import (
    FrameServer,
    LiveMessage,
    contacts_message,
    frame_message,
    page_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray
    from starlette.requests import Request
    from starlette.routing import BaseRoute

    Floats = NDArray[np.float64]
    Json = dict[str, Any]

PERIOD_NS: Final = 20_000_000
ROWS: Final = 5
STRETCH_NS: Final = ROWS * PERIOD_NS
STRETCHES: Final = 60
LOOP_NS: Final = STRETCHES * STRETCH_NS
PAST: Final = 600
"""So many loops are stored when the cloud starts."""
THRESHOLD: Final = 3000.0
LEAST_WIDTH: Final = 64.0
LATE_NS: Final = 2_000_000_000
"""How much later live frames come where they lag."""
DEAD: Final = 1777
"""A taxel of so many is broken: nothing is known of it."""
_COLUMNS: Final = 64
_PATCHES_A_PAGE: Final = 33

Mode = Literal["normal", "silent", "missing page", "lagging", "compacted", "past", "closed"]
"""Whether live frames come, come all, and come in time; or the stream is refused."""
OUTAGE_NS: Final = 60_000_000_000
"""Live frames of the past hold what was measured so long ago."""


@dataclass(frozen=True)
class Recorded:
    """One quantity of a skin over one loop.

    Attributes:
        quantity: Its name.
        unit: UCUM code.
        lo: Lower bounds, shape ``(rows, taxels)``.
        hi: Upper bounds.
    """

    quantity: str
    unit: str
    lo: Floats
    hi: Floats


class World:
    """One node's skin: layout, samples of one loop, contacts of each stretch."""

    def __init__(self, node: str, pitch_mm: Literal[1, 20], *, widening: float) -> None:
        self.node = node
        shape = HandShape(shape="hand", pitch_mm=pitch_mm).build()
        self.positions = np.rint(shape.unrolled * 1e6).astype(int)
        self.taxels = shape.names
        self.area = shape.cell_area
        edges = _edges(shape)
        self._skin = ContactSkin.from_edges(self.positions * 1e-6, self.area, edges)
        self.recorded = [_pressure(self.positions * 1e-6, widening)]
        if pitch_mm == 20:
            self.recorded.append(_temperature(self.positions * 1e-6))
        self._describe(edges)
        self.frames = [self._pack(stretch) for stretch in range(STRETCHES)]
        self.contacts = [self._touch(stretch) for stretch in range(STRETCHES)]

    def _describe(self, edges: NDArray[np.int64]) -> None:
        inside, across = _divide(edges)
        self.patches: list[Patch] = []
        self.columns: list[tuple[Recorded, slice]] = []
        for recorded in self.recorded:
            touch = recorded.quantity == "pressure"
            for start in range(0, len(self.taxels), _COLUMNS):
                part = slice(start, min(start + _COLUMNS, len(self.taxels)))
                x, y = self.positions[part].T.tolist()
                patch = Patch(
                    f"p{len(self.patches)}",
                    recorded.quantity,
                    recorded.unit,
                    tuple(self.taxels[part]),
                    LEAST_WIDTH if touch else 0.1,
                    positions=(tuple(x), tuple(y)),
                    neighbours=inside.get(start // _COLUMNS, ()) if touch else (),
                    threshold=THRESHOLD if touch else None,
                    cell_area=self.area if touch else None,
                )
                self.patches.append(patch)
                self.columns.append((recorded, part))
        counts = [_PATCHES_A_PAGE] * (len(self.patches) // _PATCHES_A_PAGE)
        rest = len(self.patches) - sum(counts)
        pages = (*counts, rest) if rest else tuple(counts)
        hashes = tuple(patch.content_hash for patch in self.patches)
        self.layout = Layout(hashes, pages, across)
        self.described = DescribedLayout.of(self.layout, self.patches)

    def _pack(self, stretch: int) -> list[Frame]:
        rows = slice(stretch * ROWS, (stretch + 1) * ROWS)
        return self.pack({one.quantity: (one.lo[rows], one.hi[rows]) for one in self.recorded})

    def pack(
        self, values: dict[str, tuple[Floats, Floats]], period: int = PERIOD_NS
    ) -> list[Frame]:
        """A frame of each page, with a row for each row of bounds."""
        frames = []
        rows = len(next(iter(values.values()))[0])
        grid = Grid(0, period, 0, rows, 0.999)
        for page in range(len(self.layout.pages)):
            samples = []
            for number in self.layout.page_range(page):
                recorded, part = self.columns[number]
                if recorded.quantity not in values:
                    continue
                lo, hi = (side[:, part] for side in values[recorded.quantity])
                width = self.patches[number].least_width
                packed = PatchSamples.pack(
                    Interval(lo, hi), width, patch=number, grid=0, first_row=0
                )
                samples.append(packed)
            if samples:
                frames.append(
                    Frame(
                        Position(1, 0),
                        self.described.hash,
                        page,
                        0,
                        (0, 1000),
                        (grid,),
                        tuple(samples),
                    )
                )
        return frames

    def _touch(self, stretch: int) -> Json:
        """Contacts of a stretch's last row."""
        pressure = self.recorded[0]
        row = stretch * ROWS + ROWS - 1
        lo, hi = pressure.lo[row], pressure.hi[row]
        low, high = (np.where(np.isinf(lo), np.nan, side) for side in (lo, hi))
        found = find_contacts(low, high, self._skin, THRESHOLD)
        cores = [
            {
                "cells": list(one.cells),
                "area": list(one.area),
                "force": [b if math.isfinite(b) else None for b in one.force],
                "centroid": [list(each) for each in one.centroid],
                "taxels": [self.taxels[k] for k in np.flatnonzero(found.core_of == one.core)],
            }
            for one in found
        ]
        regions = [
            {
                "contacts": list(region.count),
                "taxels": [self.taxels[k] for k in np.flatnonzero(found.region_of == number)],
            }
            for number, region in enumerate(found.regions)
        ]
        head = {"node": self.node, "time_error": 1000, "threshold": THRESHOLD, "unit": "Pa"}
        return {**head, "cores": cores, "regions": regions}

    def contacts_at(self, number: int) -> Json:
        """Contacts of a stretch, counted from 1970."""
        last = (number + 1) * STRETCH_NS - PERIOD_NS
        return {**self.contacts[number % STRETCHES], "t": format_timestamp(last)}

    def hulls(self, quantity: str, start: int, step: int, count: int) -> tuple[Floats, Floats]:
        """Hull of all samples in each of so many steps, shape ``(count, taxels)``."""
        recorded = next(one for one in self.recorded if one.quantity == quantity)
        first, each = start // PERIOD_NS, max(1, step // PERIOD_NS)
        offsets = np.arange(min(each, STRETCHES * ROWS))
        rows = (first + each * np.arange(count)[:, None] + offsets) % (STRETCHES * ROWS)
        lo = np.stack([recorded.lo[one].min(axis=0) for one in rows])
        return lo, np.stack([recorded.hi[one].max(axis=0) for one in rows])


class SkinCloud(FrameServer):
    """The server on loopback.

    Attributes:
        mode: How the live stream is disturbed.
        worlds: The nodes.
        start: From which instant (ns) on data are stored.
    """

    def __init__(self, port: int | None = None, *, widening: float = 1.0) -> None:
        self.mode: Mode = "normal"
        self.worlds = {
            "hand": World("hand", 1, widening=widening),
            "glove": World("glove", 20, widening=widening),
        }
        self.start = (time.time_ns() // LOOP_NS - PAST) * LOOP_NS
        layouts = {node: world.described for node, world in self.worlds.items()}
        super().__init__(STRETCH_NS, layouts, port)

    def controls(self) -> list[BaseRoute]:
        return [Route("/mode/{mode}", self._set_mode, methods=["POST"])]

    def routes(self) -> list[BaseRoute]:
        node = "/nodes/{node}"
        return [
            Route("/nodes", self._nodes),
            Route("/gateways", self._gateways),
            Route("/storage", lambda _: JSONResponse(_STORAGE)),
            Route("/models", lambda _: page_of([])),
            Route("/events", lambda _: page_of([])),
            Route("/contacts", self._contacts),
            Route(f"{node}/channels", self._channels),
            Route(f"{node}/taxels", lambda _: page_of([])),
            Route(f"{node}/state", lambda _: JSONResponse(_STATE)),
            Route(f"{node}/frames", self._frames),
            Route("/series/{node}/{channel}", self._series),
        ]

    def _set_mode(self, request: Request) -> Response:
        self.mode = request.path_params["mode"]
        return Response(status_code=204)

    def _nodes(self, _: Request) -> Response:
        now = format_timestamp(time.time_ns())
        return page_of(
            [
                {
                    "id": world.node,
                    "health": "online",
                    "last_seen": now,
                    "boot": 1,
                    "sequence": 1,
                    "profile": "paper-hand",
                    "description": None,
                    "uptime_ns": 10**12,
                    "outbox": {"messages": 3, "bytes": 20_000, "capacity_bytes": 2**20},
                    "gaps": 0,
                    "energy": None,
                    "faults": None,
                    "channels": len(world.taxels) * len(world.recorded),
                    "lag": {"lo_ns": 4_000_000, "hi_ns": 9_000_000},
                    "clock": None,
                    "missing": None,
                    "layout": world.described.hash.hex(),
                }
                for world in self.worlds.values()
            ]
        )

    def _gateways(self, _: Request) -> Response:
        now = format_timestamp(time.time_ns())
        spool = {
            "messages": 2,
            "bytes": 80_000,
            "capacity_bytes": 2**30,
            "oldest_ns": 120_000_000,
            "dead_letters": 0,
        }
        gateway = {
            "id": "gateway.1",
            "site": "home",
            "health": "online",
            "first_heard": now,
            "last_heard": now,
            "latest": now,
            "nodes": 2,
            "stored": 120_000,
            "duplicate": 0,
            "rejected": 0,
            "lag": {"lo_ns": 4_000_000, "hi_ns": 9_000_000},
            "spool": spool,
        }
        return page_of([gateway])

    def _world(self, request: Request) -> World:
        return self.worlds[request.path_params["node"]]

    def _channels(self, request: Request) -> Response:
        world = self._world(request)
        wanted = request.query_params.get("quantity")
        text = request.query_params.get("text", "").lower()
        items = [
            _channel(f"{taxel}.{one.quantity}", one, self.start, self.end)
            for one in world.recorded
            if wanted in (None, one.quantity)
            for taxel in world.taxels
            if text in f"{taxel}.{one.quantity}".lower()
        ]
        start = int(request.query_params.get("cursor", 0))
        limit = int(request.query_params.get("limit", 500))
        following = start + limit if start + limit < len(items) else None
        return page_of(items[start : start + limit], following)

    def _window(self, request: Request) -> tuple[int, int, int]:
        query = request.query_params
        points = int(query.get("points", 100))
        start, end = max(int(query["start"]), self.start), min(int(query["end"]), self.end)
        start = start // PERIOD_NS * PERIOD_NS
        rows = max(0, -(-(end - start) // PERIOD_NS))
        step = PERIOD_NS * max(1, math.ceil(rows / points))
        return start, step, max(0, -(-(end - start) // step))

    def _frames(self, request: Request) -> Response:
        world = self._world(request)
        start, step, count = self._window(request)
        quantity = request.query_params.get("quantity", "pressure")
        body = b""
        if count > 0:
            lo, hi = world.hulls(quantity, start, step, count)
            for row in range(0, count, ROWS):
                part = slice(row, row + ROWS)
                begin = start + row * step
                for frame in world.pack({quantity: (lo[part], hi[part])}, step):
                    body += replace(frame, time=(begin, begin + 1000)).encode()
        return Response(body, media_type="application/cbor-seq")

    def _contacts(self, request: Request) -> Response:
        world = self.worlds[request.query_params["node"]]
        query = request.query_params
        start, end, points = (int(query[name]) for name in ("start", "end", "points"))
        instants = (start + (k + 1) * (end - start) // points - 1 for k in range(points))
        # Those of the last row of a stretch are known.
        numbers = {(t - STRETCH_NS + PERIOD_NS) // STRETCH_NS for t in instants if t < self.end}
        return page_of([world.contacts_at(number) for number in sorted(numbers)])

    def _series(self, request: Request) -> Response:
        world = self._world(request)
        taxel, _, quantity = request.path_params["channel"].partition(".")
        recorded = next(one for one in world.recorded if one.quantity == quantity)
        start, step, count = self._window(request)
        column = world.taxels.index(taxel)
        rows = (start + step * np.arange(count)) // PERIOD_NS
        each = np.arange(min(step // PERIOD_NS, STRETCHES * ROWS))
        picked = (rows[:, None] + each) % (STRETCHES * ROWS)
        lo = recorded.lo[:, column][picked].min(axis=1) if count else np.zeros(0)
        hi = recorded.hi[:, column][picked].max(axis=1) if count else np.zeros(0)
        return JSONResponse(
            {
                "node": world.node,
                "channel": f"{taxel}.{quantity}",
                "unit": recorded.unit,
                "coverage": 0.999,
                "resolution": "sample" if step == PERIOD_NS else "hull",
                "t0": format_timestamp(start),
                "t": (step * np.arange(count)).tolist(),
                "lo": [one if math.isfinite(one) else None for one in lo.tolist()],
                "hi": [one if math.isfinite(one) else None for one in hi.tolist()],
                "mean": None,
                "dt": step,
                "time_error": 1000,
            }
        )

    @property
    def refuses(self) -> bool:
        return self.mode == "closed"

    @property
    def delay_ns(self) -> int:
        return LATE_NS if self.mode == "lagging" else 0

    def skipped_before(self, number: int) -> int | None:
        if self.mode == "compacted" and number % 20 == 0:
            return None
        return 7 if self.mode == "lagging" and number % 20 == 0 else 0

    def following(self, number: int) -> int:
        late = self.mode == "lagging"
        return number + 1 if late else max(number + 1, self.end // STRETCH_NS - 3)

    def messages_of(self, number: int) -> Iterator[LiveMessage]:
        if self.mode == "silent":
            return
        if self.mode == "past":
            number -= OUTAGE_NS // STRETCH_NS
        begin = number * STRETCH_NS
        for world in self.worlds.values():
            for frame in world.frames[number % STRETCHES]:
                if self.mode == "missing page" and frame.page == 1:
                    continue
                sequence = number * len(world.layout.pages) + frame.page
                moved = replace(
                    frame,
                    position=Position(1, sequence),
                    ticks=begin - self.start,
                    time=(begin, begin + 1000),
                )
                yield frame_message(world.node, moved)
            yield contacts_message(world.node, world.contacts_at(number))


def _edges(shape: Any) -> NDArray[np.int64]:
    pairs = np.asarray(shape.neighbours)
    if pairs.shape[1] != 2:
        rows = np.repeat(np.arange(len(pairs)), pairs.shape[1])
        pairs = np.stack([rows, pairs.ravel()], axis=1)
    pairs = pairs[(pairs[:, 0] < pairs[:, 1]) & (pairs[:, 0] >= 0)]
    return np.unique(pairs, axis=0)


def _divide(
    edges: NDArray[np.int64],
) -> tuple[dict[int, tuple[tuple[int, int], ...]], tuple[Seam, ...]]:
    """Neighbours within each patch, and those in two patches, as columns."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for one, other in edges.tolist():
        patches = one // _COLUMNS, other // _COLUMNS
        found.setdefault(patches, []).append((one % _COLUMNS, other % _COLUMNS))
    inside = {one: tuple(sorted(pairs)) for (one, other), pairs in found.items() if one == other}
    across = [
        Seam(one, other, tuple(sorted(pairs)))
        for (one, other), pairs in sorted(found.items())
        if one != other
    ]
    return inside, tuple(across)


def _pressure(positions: Floats, widening: float) -> Recorded:
    """A finger that circles on the palm, one that slides along the index finger, a pinch."""
    rows = STRETCHES * ROWS
    phase = 2 * np.pi * np.arange(rows)[:, None] / rows
    x, y = positions.T * 1e3
    near = (x - (40 + 22 * np.cos(phase))) ** 2 + (y - (30 + 16 * np.sin(phase))) ** 2
    value = 26e3 * np.exp(-near / 60)
    slide = (x - 29) ** 2 / 20 + (y - (84 + 14 * np.sin(2 * phase))) ** 2 / 40
    value += 18e3 * np.exp(-slide)
    pinch = np.clip(np.sin(phase), 0, None) * 34e3
    value += pinch * np.exp(-((x - 95) ** 2 + (y - 20) ** 2) / 18)
    noise = np.random.default_rng(7).uniform(-40, 40, value.shape)
    blurred = 8.0 * np.clip((x - 60) / 15, 0, 1) * (y > 62)
    width = widening * (64 + 0.03 * value + 260 * blurred)
    lo, hi = value + noise - width / 2 - 40, value + noise + width / 2 + 40
    dead = np.arange(value.shape[1]) % DEAD == DEAD - 1
    return Recorded("pressure", "Pa", np.where(dead, -np.inf, lo), np.where(dead, np.inf, hi))


def _temperature(positions: Floats) -> Recorded:
    rows = STRETCHES * ROWS
    phase = 2 * np.pi * np.arange(rows)[:, None] / rows
    value = 31 + positions[:, 1] * 20 + 0.5 * np.sin(phase + positions[:, 0] * 40)
    return Recorded("temperature", "Cel", value - 0.2, value + 0.2)


def _channel(name: str, recorded: Recorded, start: int, end: int) -> Json:
    taxel, _, quantity = name.partition(".")
    samples = (end - start) // PERIOD_NS
    return {
        "id": name,
        "taxel": taxel,
        "quantity": quantity,
        "unit": recorded.unit,
        "coverage": 0.999,
        "dt": PERIOD_NS,
        "blocks": None,
        "samples": samples,
        "bytes": None,
        "first": format_timestamp(start),
        "last": format_timestamp(end - PERIOD_NS),
        "bounds": None,
        "biometric": False,
        "removed": None,
    }


_STATE: Final[Json] = {
    "node": "hand",
    "desired": {},
    "desired_at": None,
    "desired_by": None,
    "reported": {},
    "reported_at": None,
    "reported_by": None,
    "settled": True,
}
_STORAGE: Final = {
    "samples": 10**9,
    "bytes": 10**9,
    "free_bytes": 10**11,
    "bytes_per_sample": 1.0,
}


def main() -> None:
    """Serve until interrupted."""
    parser = argparse.ArgumentParser(prog="python -m tests.unit.dashboard.skin_cloud")
    parser.add_argument("--port", type=int, default=8899)
    parser.add_argument("--widening", type=float, default=1.0, help="factor of the widths")
    options = parser.parse_args()
    cloud = SkinCloud(options.port, widening=options.widening)
    sys.stdout.write(f"{cloud.url}\n")
    sys.stdout.flush()
    cloud.server.run()


if __name__ == "__main__":
    main()
