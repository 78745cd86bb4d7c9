"""The write-ahead log of the cloud's store, as a crash leaves it.

SQLite drops a damaged transaction and all after it. The store is then older than its answers to
gateways, and names the messages that it lacks.
"""

from __future__ import annotations

import asyncio
import logging
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

import cbor2

from eskin.identity import IdentityKind
from eskin.wire.timestamp import SECOND
from tests.robustness.bitflips.part import Part
from tests.support.identities import Identities
from tests.unit.cloud.clouds import batch, standing
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

log = logging.getLogger("eskin_cloud.bitflips")

_STORE: Final = "store.sqlite"
_LOG: Final = f"{_STORE}-wal"
_COUNT: Final = 24


@cache
def _identities() -> Identities:
    made = Identities(Path(mkdtemp(prefix="eskin-bitflips-")))
    made.make(IdentityKind.SERVER, "server.cloud")
    return made


def make(folder: Path) -> None:
    """Store messages, and copy the files while the cloud runs."""
    running = Path(mkdtemp(prefix="eskin-bitflips-"))
    with standing(running, _identities()) as stand:
        asyncio.run(_bring(stand))
        for name in (_STORE, _LOG):
            shutil.copy(running / name, folder / name)
    shutil.rmtree(running)


async def _bring(stand: Stand) -> None:
    for number in range(_COUNT):
        time = (START + number * SECOND,) * 2
        said = stretch(number, [1.0 + number], [2.0 + number], time=time)
        assert (await stand.ingest(batch(said))).status_code == 200


def read(folder: Path) -> dict[str, Any]:
    """Start the cloud again, compare what was confirmed with it, and read what it has."""
    with standing(folder, _identities()) as stand:
        return asyncio.run(_read(stand))


async def _read(stand: Stand) -> dict[str, Any]:
    async with stand.ingest_client() as gateway:
        body = cbor2.dumps([[NODE, 1, _COUNT - 1]])
        answer = await gateway.post("/api/v1/confirmed", content=body)
    missing = {
        number
        for item in answer.json()["items"]
        for number in range(item["first"], item["last"] + 1)
    }
    if missing:
        log.warning("confirmed messages missing: %s", sorted(missing))
    window = {"start": START - SECOND, "end": START + 3600 * SECOND, "points": 1000}
    series = (await stand.get(f"/api/v1/series/{NODE}/{CHANNEL}", **window)).json()
    bounds = zip(series.get("lo", ()), series.get("hi", ()), strict=True)
    found = {int(lo) - 1: (lo, hi) for lo, hi in bounds if lo is not None}
    assert found.keys() | missing == set(range(_COUNT)), "neither stored nor named as missing"
    return {f"message {number}": each for number, each in found.items()}


PART: Final = Part(make, read, (_LOG,))
