"""A cloud for looking at: months of one channel in its store, and many channels that are live."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from itertools import count
from typing import TYPE_CHECKING, Final, Self

import cbor2
import numpy as np
from eskin_cloud.store import Store
from rich.progress import Progress

from benchmarks.long_store import LongStore
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from tests.support.identities import Identities
from tests.support.processes import wait_until
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

LIVE: Final = "skin"
"""The node whose channels are live."""
_DT: Final = 1_000_000
_ROWS: Final = 50
_WIDTH: Final = 1e-12


class Stage:
    """A cloud process, and a thread that brings it frames of 1 kHz.

    Args:
        folder: Where all lies.
        live: How many channels are live.
        stored: Samples of the node ``fingertip``, ``t01.capacitance``, which is not live.
        dt: Their distance in ns.
        more: Further lines of the settings of ``[people]``.
    """

    def __init__(
        self,
        folder: Path,
        *,
        live: int,
        stored: int = 0,
        dt: int = 250_000_000,
        more: str = "",
    ) -> None:
        folder.mkdir()
        self.service = Service(folder, Identities(folder / "pki"), more=more)
        taxels = tuple(f"t{number + 1:02}" for number in range(live))
        self._patch = Patch("live", "capacitance", "F", taxels, _WIDTH)
        self._layout = Layout((self._patch.content_hash,), (1,))
        self._stored, self._dt = stored, dt
        self._done = threading.Event()
        self._source = threading.Thread(target=self._feed, name="source")
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        if self._stored:
            with Store(self.service.place) as store, Progress() as screen:
                long = LongStore(store, screen, dt=self._dt)
                long.grow(self._stored)
                long.build()
        self._stack.enter_context(self.service)
        self.token = self.service.token()
        self._source.start()
        with self.service.people(self.token) as client:
            place = f"/api/v1/nodes/{LIVE}"
            wait_until(lambda: client.get(place).is_success, f"{LIVE} is live")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._done.set()
        self._source.join()
        self._stack.close()

    @property
    def url(self) -> str:
        """Where people come."""
        return f"http://127.0.0.1:{self.service.port}"

    def _feed(self) -> None:
        span = _ROWS * _DT
        first = time.time_ns()
        self.service.admit(LIVE)
        described = [[LIVE, each.encode()] for each in (self._patch, self._layout)]
        with self.service.gateway_client() as client:
            body = cbor2.dumps(described)
            client.post("/api/v1/descriptions", content=body).raise_for_status()
            for number in count():
                start = first + number * span
                if self._done.wait(max(0.0, (start + span - time.time_ns()) / 1e9)):
                    return
                body = cbor2.dumps([[LIVE, self._frame(number, start)]])
                client.post("/api/v1/ingest", content=body).raise_for_status()

    def _frame(self, number: int, start: int) -> bytes:
        at = start + _DT * np.arange(_ROWS)
        phase = (at % 10**9)[:, np.newaxis] / 1e9 * 2 * np.pi
        lo = 1e-11 * (2 + np.sin(phase + np.arange(len(self._patch.taxels))))
        values = Interval(lo, lo + _WIDTH)
        samples = PatchSamples.pack(values, _WIDTH, patch=0, grid=0, first_row=0)
        ticks, time = number * _ROWS * _DT, (start, start)
        name, grid = self._layout.content_hash, Grid(0, _DT, 0, _ROWS, 1.0)
        return Frame(Position(1, number), name, 0, ticks, time, (grid,), (samples,)).encode()
