"""``python -m benchmarks.capacity``: what a cloud holds before it refuses, and that all is stored.

Gateways' batches come at a fixed rate, whether those before them are answered or not; the rate is
raised until the first one is refused. What was refused is sent again, as a gateway does, and in the
end each frame must be stored once. Writes ``build/capacity.json``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import cbor2
import httpx
from rich.console import Console
from rich.table import Table

from benchmarks.said import FEW, NODE, descriptions, say
from eskin.identity import client_context
from tests.support.identities import Identities
from tests.support.postgresql import Cluster
from tests.support.stores import ask_store
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Sequence

_BATCH: Final = 50
_FASTER: Final = 1.5
_BEHIND: Final = 1.2
"""Where a step takes so many times as long, it is we who cannot send any faster, or it who answers
slowly; then there is nothing more to find."""
_CONNECTIONS: Final = 200
_TIMEOUT_S: Final = 120.0
_REFUSALS: Final = (429, 503)
_PAUSE_S: Final = 0.2
_STORED: Final = """
    SELECT coalesce(sum(last - first + 1), 0) FROM sequences
"""
"""Each number is in one range at most; what is compacted is counted, too."""
_HEADERS: Final = {"Content-Type": "application/cbor"}


@dataclass(slots=True)
class Step:
    """One rate.

    Attributes:
        rate: Frames a second that were to come.
        reached: That came.
        refused: Batches that were refused, by status.
        slowest_s: The slowest answer.
    """

    rate: float
    reached: float = 0.0
    refused: Counter[int] = field(default_factory=Counter)
    slowest_s: float = 0.0


@dataclass(slots=True)
class Found:
    """What a cloud holds.

    Attributes:
        steps: Rates, rising; the last one was refused, or could not be sent.
        sent: Frames.
        stored: Frames in the store.
    """

    steps: list[Step] = field(default_factory=list)
    sent: int = 0
    stored: int = 0


class Gateways:
    """Bring batches to a cloud."""

    def __init__(self, service: Service) -> None:
        self._url = f"https://localhost:{service.ingest_port}/api/v1/ingest"
        self._client = httpx.AsyncClient(
            verify=client_context(service.server.directory / "root.pem", service.gateway),
            timeout=_TIMEOUT_S,
            trust_env=False,
            limits=httpx.Limits(max_connections=_CONNECTIONS),
        )

    async def bring(self, bodies: Sequence[bytes], step: Step, *, every_s: float) -> list[bytes]:
        """Send each when it is due; gives what was refused."""
        begun = time.monotonic()

        async def one(number: int, body: bytes) -> int:
            await asyncio.sleep(max(0.0, begun + number * every_s - time.monotonic()))
            asked = time.monotonic()
            status = await self._post(body)
            step.slowest_s = max(step.slowest_s, time.monotonic() - asked)
            return status

        statuses = await asyncio.gather(*(one(k, body) for k, body in enumerate(bodies)))
        step.reached = len(bodies) * _BATCH / (time.monotonic() - begun)
        step.refused.update(status for status in statuses if status in _REFUSALS)
        return [body for body, status in zip(bodies, statuses, strict=True) if status != 200]

    async def bring_again(self, bodies: Sequence[bytes]) -> None:
        """Send what was refused, until it is taken."""
        for body in bodies:
            while await self._post(body) != 200:  # noqa: ASYNC110 - as gateways wait
                await asyncio.sleep(_PAUSE_S)

    async def describe(self) -> None:
        """Send what describes the frames."""
        body = cbor2.dumps([[NODE, each] for each in descriptions(FEW)])
        url = self._url.replace("/ingest", "/descriptions")
        (await self._client.post(url, content=body, headers=_HEADERS)).raise_for_status()

    async def close(self) -> None:
        """Leave."""
        await self._client.aclose()

    async def _post(self, body: bytes) -> int:
        answer = await self._client.post(self._url, content=body, headers=_HEADERS)
        assert answer.status_code in {200, *_REFUSALS}, answer.text
        return answer.status_code


async def find_capacity(
    service: Service, *, rate: float, seconds: float, steps: int, behind: float = _BEHIND
) -> Found:
    """Raise the rate until something is refused.

    Args:
        service: A running cloud with an empty store.
        rate: Frames a second to begin with.
        seconds: How long each rate lasts.
        steps: Rates at most.
        behind: How many times as long as it should a step may take.
    """
    found, gateways = Found(), Gateways(service)
    refused: list[bytes] = []
    service.admit(NODE)
    try:
        await gateways.describe()
        while not refused and len(found.steps) < steps:
            step = Step(rate)
            bodies = _bodies(max(1, round(rate * seconds / _BATCH)), boot=len(found.steps) + 1)
            refused = await gateways.bring(bodies, step, every_s=_BATCH / rate)
            found.steps.append(step)
            found.sent += len(bodies) * _BATCH
            if step.reached * behind < rate and not refused:
                break
            rate *= _FASTER
        await gateways.bring_again(refused)
    finally:
        await gateways.close()
    found.stored = ask_store(service.place, _STORED)[0][0]
    return found


def _bodies(count: int, *, boot: int) -> list[bytes]:
    said = say(FEW, count * _BATCH, boot=boot)
    return [
        cbor2.dumps([list(one) for one in said[at : at + _BATCH]])
        for at in range(0, len(said), _BATCH)
    ]


def _table(found: Found) -> Table:
    title = f"{found.sent} frames of 500 samples sent, {found.stored} stored"
    table = Table("frames/s", "reached", "refused", "slowest answer, s", title=title)
    for step in found.steps:
        refused = ", ".join(f"{count} by {status}" for status, count in step.refused.items())
        row = f"{step.rate:.0f}", f"{step.reached:.0f}", refused or "none", f"{step.slowest_s:.2f}"
        table.add_row(*row)
    return table


def main() -> None:
    """Measure, print, write; exit 1 where a frame is lost or doubled."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.capacity", description=__doc__)
    parser.add_argument("--rate", type=float, default=500.0, help="frames a second to begin with")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each rate")
    parser.add_argument("--steps", type=int, default=16, help="rates at most")
    parser.add_argument("--store", choices=("sqlite", "postgresql"), default="sqlite")
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="eskin-capacity-")))
        server = options.store == "postgresql"
        place = stack.enter_context(Cluster()).fresh() if server else None
        identities = Identities(folder / "pki")
        service = stack.enter_context(Service(folder / "cloud", identities, place=place))
        given = {"rate": options.rate, "seconds": options.seconds}
        found = asyncio.run(find_capacity(service, steps=options.steps, **given))
    Console().print(_table(found))
    target = Path("build/capacity.json")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(asdict(found), indent=2) + "\n")
    sys.exit(0 if found.stored == found.sent else 1)


if __name__ == "__main__":
    main()
