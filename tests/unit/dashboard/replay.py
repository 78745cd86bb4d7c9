"""A cloud that answers from a recording, so that a page can be tested without a demo.

The recorded stretch of series and events is repeated without end, up to the present, and the live
stream goes on with it. Only what the dashboard asks for is answered.
"""

from __future__ import annotations

import json
import lzma
import math
import time
from typing import TYPE_CHECKING, Any, Final

import httpx
import numpy as np
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from eskin.interval import Interval
from eskin.wire.frames import DescribedLayout, Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.frames.sample_codec import MOST_ROWS
from eskin.wire.messages import Position
from eskin.wire.timestamp import format_timestamp, parse_timestamp
from tests.support.processes import PLAIN
from tests.unit.dashboard.frame_server import (
    FrameServer,
    LiveMessage,
    event_message,
    frame_message,
    page_of,
)
from tests.unit.dashboard.record import LENGTH_NS, RECORDING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray
    from starlette.requests import Request
    from starlette.routing import BaseRoute

    Floats = NDArray[np.float64]
    Json = dict[str, Any]

STRETCH_NS: Final = 250_000_000
"""A live frame has so much of each channel; all of them come at the same instant."""
PAST: Final = 5
"""So many repetitions are stored before the first one that is live."""
_MISSING_PARAMETER: Final = {
    "title": "Invalid",
    "status": 422,
    "detail": "parameter: minimum_area is missing",
}


class Replay(FrameServer):
    """A server on loopback with the recorded world.

    Attributes:
        start: The instant (ns) of its first sample; each repetition begins ``LENGTH_NS`` later.
    """

    def __init__(self) -> None:
        self._recording: Json = json.loads(lzma.decompress(RECORDING.read_bytes()))
        self.start = (time.time_ns() // LENGTH_NS - PAST) * LENGTH_NS
        self._series = {
            name: _Channel(series, self._recording["start"], self.start)
            for name, series in self._recording["series"].items()
        }
        self._skins = {node: self._skin(node) for node in self._recording["channels"]}
        super().__init__(STRETCH_NS, {node: one.described for node, one in self._skins.items()})

    def _skin(self, node: str) -> _Skin:
        channels = self._recording["channels"][node]
        series = {one["id"]: self._series[f"{node}/{one['id']}"] for one in channels}
        return _Skin(channels, series, self._recording["places"][node])

    def get(self, path: str, **parameters: object) -> Any:
        """The JSON answer of the REST API."""
        with httpx.Client(base_url=self.url, verify=PLAIN, timeout=60) as client:
            answer = client.get(f"/api/v1{path}", params={k: str(v) for k, v in parameters.items()})
            answer.raise_for_status()
            return answer.json()

    def routes(self) -> list[BaseRoute]:
        series = "/series/{node}/{channel}"
        return [
            Route("/nodes", self._nodes),
            Route("/gateways", self._gateways),
            Route("/storage", lambda _: JSONResponse(self._recording["storage"])),
            Route("/models", lambda _: page_of(self._recording["models"])),
            Route("/nodes/{node}/channels", self._channels),
            Route("/nodes/{node}/state", self._of_node("states", JSONResponse)),
            Route("/events", self._events),
            Route("/contacts", lambda _: page_of([])),
            Route("/nodes/{node}/frames", self._frames),
            Route(series, self._one_series),
            Route(f"{series}/threshold", self._threshold),
            Route(f"{series}/time", self._time),
            Route(f"{series}/prediction", self._prediction),
            Route(f"{series}/anomalies", lambda _: page_of([])),
            Route(f"{series}/anomalies/time", self._time),
        ]

    def _nodes(self, _: Request) -> Response:
        now = format_timestamp(time.time_ns())
        return page_of(
            [
                {**node, "last_seen": now, "layout": self.layouts[node["id"]].hash.hex()}
                for node in self._recording["nodes"]
            ]
        )

    def _gateways(self, _: Request) -> Response:
        now = format_timestamp(time.time_ns())
        return page_of([{**one, "last_heard": now} for one in self._recording["gateways"]])

    def _channels(self, request: Request) -> Response:
        node = request.path_params["node"]
        items = []
        for item in self._recording["channels"].get(node, []):
            channel = self._series[f"{node}/{item['id']}"]
            t, _, _ = channel.between(self.end - LENGTH_NS, self.end)
            first, last = channel.first(self.start), int(t[-1])
            stored = {"first": format_timestamp(first), "last": format_timestamp(last)}
            items.append({**item, **stored})
        return page_of(items)

    def _frames(self, request: Request) -> Response:
        query = request.query_params
        start, end = max(int(query["start"]), self.start), min(int(query["end"]), self.end)
        skin = self._skins[request.path_params["node"]]
        frames = skin.pictures(query["quantity"], start, end, int(query["points"]))
        body = b"".join(frame.encode() for frame in frames)
        return Response(body, media_type="application/cbor-seq")

    def _of_node(self, name: str, answer: Any) -> Any:
        return lambda request: answer(self._recording[name][request.path_params["node"]])

    def _window(self, request: Request) -> tuple[str, _Channel, int, int]:
        node, channel = (request.path_params[name] for name in ("node", "channel"))
        start, end = (int(request.query_params[name]) for name in ("start", "end"))
        return f"{node}/{channel}", self._series[f"{node}/{channel}"], start, end

    def _one_series(self, request: Request) -> Response:
        _, channel, start, end = self._window(request)
        points = int(request.query_params["points"])
        window = max(start, self.start), min(end, self.end)
        return JSONResponse(channel.series(*window, points=points, begin=start))

    def _prediction(self, request: Request) -> Response:
        if "parameter" not in request.query_params:
            return JSONResponse(_MISSING_PARAMETER, 422)
        _, channel, start, end = self._window(request)
        points = int(request.query_params["points"])
        step = max(1, math.ceil((end - start) / points))
        t = list(range(0, end - start, step))
        hull = {"t": t, "lo": [0.0] * len(t), "hi": [1e-12] * len(t), "dt": step}
        more = {"model": "m", "origin": format_timestamp(start), "t0": format_timestamp(start)}
        return JSONResponse({**channel.names, **more, **hull})

    def _judged(self, request: Request) -> tuple[Any, ...]:
        """Samples of a window, and which are in the state certainly and possibly."""
        _, channel, start, end = self._window(request)
        t, lo, hi = channel.between(max(start, self.start), min(end, self.end))
        above = float(request.query_params.get("above", 0))
        return channel, start, end, t, lo > above, hi > above

    def _threshold(self, request: Request) -> Response:
        channel, _, _, t, certain, possible = self._judged(request)
        verdicts = np.where(certain, 2, np.where(possible, 1, 0))
        edges = np.flatnonzero(np.diff(verdicts)) + 1
        items = [
            {
                "start": format_timestamp(int(t[part[0]])),
                "includes_start": True,
                "end": format_timestamp(int(t[part[-1]]) + channel.dt),
                "includes_end": False,
                "verdict": "certain" if verdicts[part[0]] == 2 else "possible",
                "because": [] if verdicts[part[0]] == 2 else ["width"],
                "missing": False,
                "coverage": 1.0,
            }
            for part in np.split(np.arange(len(t)), edges)
            if len(part) and verdicts[part[0]]
        ]
        return page_of(items)

    def _time(self, request: Request) -> Response:
        channel, start, end, t, certain, possible = self._judged(request)
        seconds = channel.dt * 1e-9
        counts = int(certain.sum()), int(possible.sum())
        begun = int((np.diff(possible.astype(int), prepend=0) == 1).sum())
        return JSONResponse(
            {
                "start": format_timestamp(start),
                "end": format_timestamp(end),
                "time_s": {"lo": counts[0] * seconds, "hi": counts[1] * seconds},
                "unknown_s": max(0.0, (end - start) * 1e-9 - len(t) * seconds),
                "entries": {"lo": min(begun, 1), "hi": begun},
                "coverage": 1.0,
            }
        )

    def _events_between(self, start: int, end: int, wanted: Mapping[str, str]) -> list[Json]:
        """All events that begin in [start, end), the oldest first."""
        found = []
        first, last = ((one - self.start) // LENGTH_NS for one in (start, end))
        for repetition in range(max(0, first), last + 1):
            shift = self.start + repetition * LENGTH_NS - self._recording["start"]
            for event in self._recording["events"]:
                lo, hi = (parse_timestamp(event["time"][side]) + shift for side in ("lo", "hi"))
                if start <= lo < end and all(event[key] == wanted[key] for key in wanted):
                    times = {"lo": format_timestamp(lo), "hi": format_timestamp(hi)}
                    found.append({**event, "id": f"{event['id']}-{repetition}", "time": times})
        return sorted(found, key=lambda event: str(event["time"]["lo"]))

    def _events(self, request: Request) -> Response:
        query = request.query_params
        wanted = {key: query[key] for key in ("node", "channel", "kind", "verdict") if key in query}
        end = min(self.end, int(query.get("end", self.end)), int(query.get("cursor", self.end)))
        found = self._events_between(int(query.get("start", self.start)), end, wanted)[::-1]
        limit = int(query.get("limit", 100))
        more = parse_timestamp(found[limit - 1]["time"]["lo"]) if len(found) > limit else None
        return page_of(found[:limit], more)

    def messages_of(self, number: int) -> Iterator[LiveMessage]:
        start, end = number * STRETCH_NS, (number + 1) * STRETCH_NS
        for node, skin in self._skins.items():
            for frame in skin.frames(start, end):
                yield frame_message(node, frame)
        for event in self._events_between(start, end, {}):
            yield event_message(event)


class _Skin:
    """The channels of one node: those of a quantity and rate are a patch, those of a rate a page.

    Args:
        channels: As REST lists them.
        series: Their samples; those of a page are of the same instants.
        places: Where taxels are, in m.
    """

    def __init__(
        self, channels: list[Json], series: dict[str, _Channel], places: dict[str, list[float]]
    ) -> None:
        patches: dict[tuple[int, str], list[Json]] = {}
        for one in channels:
            patches.setdefault((one["dt"], one["quantity"]), []).append(one)
        described = []
        self._pages: dict[int, dict[int, list[_Channel]]] = {}
        for number, (dt, quantity) in enumerate(sorted(patches)):
            members = patches[dt, quantity]
            measured = [series[one["id"]] for one in members]
            self._pages.setdefault(dt, {})[number] = measured
            placed = [places.get(one["taxel"]) for one in members]
            positions = np.rint(np.array(placed) * 1e6).astype(int).T if all(placed) else ()
            patch = Patch(
                f"{quantity}-{number}",
                quantity,
                members[0]["unit"],
                tuple(one["taxel"] for one in members),
                min(one.least_width for one in measured),
                positions=tuple(tuple(map(int, axis)) for axis in positions),
            )
            described.append(patch)
        hashes = tuple(patch.content_hash for patch in described)
        layout = Layout(hashes, tuple(map(len, self._pages.values())))
        self.described = DescribedLayout.of(layout, described)

    def frames(self, start: int, end: int) -> Iterator[Frame]:
        """A frame of each page and run of samples in [start, end)."""
        for page, (dt, patches) in enumerate(self._pages.items()):
            first = next(iter(patches.values()))[0]
            t, lo, hi = first.between(start, end)
            known = np.flatnonzero(~(np.isnan(lo) & np.isnan(hi)))
            for run in np.split(known, np.flatnonzero(np.diff(t[known]) != dt) + 1):
                for begin in range(0, len(run), MOST_ROWS):
                    part = run[begin : begin + MOST_ROWS]
                    window = int(t[part[0]]), int(t[part[-1]]) + 1
                    values = {
                        number: self._bounds(members, *window)
                        for number, members in patches.items()
                    }
                    yield self._frame(page, window[0], dt, values)

    def _bounds(self, members: list[_Channel], start: int, end: int) -> tuple[Floats, Floats]:
        _, lo, hi = zip(*(one.between(start, end) for one in members), strict=True)
        return np.stack(lo, axis=1), np.stack(hi, axis=1)

    def pictures(self, quantity: str, start: int, end: int, points: int) -> Iterator[Frame]:
        """Frames with at most so many hulls of each channel of a quantity that never pauses."""
        for page, (dt, patches) in enumerate(self._pages.items()):
            for number, members in patches.items():
                if self.described.patches[number].quantity != quantity:
                    continue
                bounds = [one.between(start, end) for one in members]
                t = bounds[0][0]
                each = max(1, -(-(end - start) // (points * dt)))
                firsts = np.arange(0, len(t), each)
                lo = np.stack([np.minimum.reduceat(one[1], firsts) for one in bounds], axis=1)
                hi = np.stack([np.maximum.reduceat(one[2], firsts) for one in bounds], axis=1)
                for row in range(0, len(firsts), MOST_ROWS):
                    part = slice(row, row + MOST_ROWS)
                    begin = int(t[firsts[row]])
                    yield self._frame(page, begin, each * dt, {number: (lo[part], hi[part])})

    def _frame(
        self, page: int, begin: int, period: int, values: dict[int, tuple[Floats, Floats]]
    ) -> Frame:
        """A frame with rows of bounds of patches."""
        channel = next(iter(list(self._pages.values())[page].values()))[0]
        rows = len(next(iter(values.values()))[0])
        grid = Grid(0, period, 0, rows, channel.coverage)
        samples = [
            PatchSamples.pack(
                Interval(lo, hi),
                self.described.patches[number].least_width,
                patch=number,
                grid=0,
                first_row=0,
            )
            for number, (lo, hi) in values.items()
        ]
        position = Position(1, begin // 1_000_000)
        times = begin, begin + channel.time_error
        return Frame(position, self.described.hash, page, 0, times, (grid,), tuple(samples))


class _Channel:
    """A recorded series that repeats; samples lie at the same offsets in each repetition."""

    def __init__(self, series: Json, recorded: int, start: int) -> None:
        self.names = {key: series[key] for key in ("node", "channel", "unit")}
        self.dt: int = series["dt"]
        self.time_error: int = series["time_error"]
        self.coverage = series["coverage"]
        self._origin = start
        begin = parse_timestamp(series["t0"]) - recorded
        self._t = np.array(series["t"], np.int64) + begin
        self._lo = np.array(series["lo"], np.float64)
        self._hi = np.array(series["hi"], np.float64)
        missing = np.isnan(self._lo) & np.isnan(self._hi)
        self._lo[np.isnan(self._lo) & ~missing] = -np.inf
        self._hi[np.isnan(self._hi) & ~missing] = np.inf

    @property
    def least_width(self) -> float:
        """So fine that frames make the bounds wider by less than a digit that is recorded."""
        width = self._hi - self._lo
        return float(np.min(width[width > 0.0])) / 16

    def first(self, start: int) -> int:
        """The instant of the first sample of a repetition."""
        return start + int(self._t[0])

    def between(
        self, start: int, end: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Instants and bounds of the samples in [start, end)."""
        if end <= start:
            return self._t[:0], self._lo[:0], self._hi[:0]
        first, last = ((one - self._origin) // LENGTH_NS for one in (start, end))
        count = last - first + 1
        shifts = self._origin + LENGTH_NS * np.arange(first, last + 1)
        t = (shifts[:, None] + self._t).ravel()
        begin, stop = np.searchsorted(t, [start, end])
        lo, hi = (np.tile(side, count)[begin:stop] for side in (self._lo, self._hi))
        return t[begin:stop], lo, hi

    def series(self, start: int, end: int, *, points: int, begin: int) -> Json:
        """What the REST API answers: samples, or hulls where there are more than ``points``."""
        t, lo, hi = self.between(start, end)
        t0 = int(t[0]) if len(t) else begin
        step, resolution = self.dt, "sample"
        if len(t) > points:
            resolution = "hull"
            step = max(self.dt, math.ceil((end - start) / points))
            buckets = (t - t0) // step
            firsts = np.flatnonzero(np.diff(buckets, prepend=-1))
            lo, hi = np.fmin.reduceat(lo, firsts), np.fmax.reduceat(hi, firsts)  # NaN is missing
            t = t0 + buckets[firsts] * step
        return {
            **self.names,
            "coverage": self.coverage,
            "resolution": resolution,
            "t0": format_timestamp(t0),
            "t": (t - t0).tolist(),
            "lo": [one if math.isfinite(one) else None for one in lo.tolist()],
            "hi": [one if math.isfinite(one) else None for one in hi.tolist()],
            "mean": None,
            "dt": step,
            "time_error": self.time_error,
        }
