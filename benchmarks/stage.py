"""A cloud for looking at: months of one channel in its store, and many channels that are live."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from itertools import count, islice
from typing import TYPE_CHECKING, Final, Self

import cbor2
import numpy as np
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store import Store

from benchmarks.pyramid import fill, patterns
from eskin.wire.messages import Encoding
from tests.support.identities import Identities
from tests.support.processes import wait_until
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import block
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

LIVE: Final = "skin"
"""The node whose channels are live."""
_DT: Final = 1_000_000
_BLOCK: Final = 500


class Stage:
    """A cloud process, and a thread that brings it blocks of 1 kHz.

    Args:
        folder: Where all lies.
        live: How many channels are live.
        block: Samples of each block.
        stored: Samples of the node ``fingertip``, ``t01.capacitance``, which is not live.
        dt: Their distance in ns.
        more: Further lines of the settings of ``[people]``.
    """

    def __init__(
        self,
        folder: Path,
        *,
        live: int,
        block: int = 50,
        stored: int = 0,
        dt: int = 250_000_000,
        more: str = "",
    ) -> None:
        folder.mkdir()
        self.service = Service(folder, Identities(folder / "pki"), more=more)
        self._live, self._block = live, block
        self._stored, self._dt = stored, dt
        self._done = threading.Event()
        self._source = threading.Thread(target=self._feed, name="source")
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        if self._stored:
            with Store(self.service.place) as store:
                said = list(islice(patterns(self._dt), 64))
                put(store, block(0, boot=2, dt=self._dt))
                fill(store, said, 0, self._stored // _BLOCK)
                build(store)
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
        span = self._block * _DT
        first = time.time_ns()
        self.service.admit(LIVE)
        with self.service.gateway_client() as client:
            for number in count():
                start = first + number * span
                if self._done.wait(max(0.0, (start + span - time.time_ns()) / 1e9)):
                    return
                body = self._batch(number, start)
                client.post("/api/v1/ingest", content=body).raise_for_status()

    def _batch(self, number: int, start: int) -> bytes:
        at = start + _DT * np.arange(self._block)
        said = []
        for channel in range(self._live):
            lo = 1e-11 * (2 + np.sin(2 * np.pi * (at % 10**9) / 1e9 + channel))
            one = block(
                number * self._live + channel,
                lo,
                lo + 1e-12,
                time=(start, start),
                channel=f"t{channel + 1:02}.capacitance",
                encoding=Encoding.Q16,
            )
            said.append([LIVE, one.encode()])
        return cbor2.dumps(said)
