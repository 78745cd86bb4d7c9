"""A skin in the cloud's SQLite store: fresh frames, rows of compacted ones, tiles, descriptions."""

from __future__ import annotations

import asyncio
import logging
import sqlite3
from contextlib import closing
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

import cbor2
from eskin_cloud.access import Scope, create_token
from eskin_cloud.api.middleware.answer import DAMAGED
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.schema.frame_tables import (
    descriptions,
    frames,
    pages,
    patch_rows,
    patch_tiles,
    patches,
)

from eskin.wire.timestamp import SECOND, parse_timestamp
from tests.robustness.bitflips.part import Part
from tests.robustness.bitflips.parts.store import WINDOW, Asker, identities, standing
from tests.unit.cloud.clouds import batch, put
from tests.unit.cloud.clouds import standing as fresh_cloud
from tests.unit.cloud.messages import NODE
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.wire.frames import Frame

log = logging.getLogger("eskin_cloud.bitflips")

_STORE: Final = "store.sqlite"
_COMPACTED: Final = 200
_FRESH: Final = 40
_CHANNELS: Final = ("palm-0.pressure", "tip-1.pressure", "warm-0.temperature")
_QUANTITIES: Final = ("pressure", "temperature")
_ALL: Final = Due(2**62, 2**62)
_PICTURES: Final = (3, 2000)


def _said(number: int) -> Frame:
    return frame(number, page=number % 2, at=number * SECOND // 10, seed=number)


def make(folder: Path) -> None:
    """Frames of twenty seconds that are compacted and folded into tiles, and of four afterwards."""
    with fresh_cloud(folder, identities()) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        put(store, *map(_said, range(_COMPACTED)))
        for page in find_compactable_frames(store, _ALL):
            while compact_frames(store, page, _ALL):
                pass
        build(store)
        put(store, *map(_said, range(_COMPACTED, _COMPACTED + _FRESH)))
        token = create_token(store, name="reader", scopes=[Scope.READ], lifetime=timedelta(days=9))
        (folder / "secrets").write_bytes(cbor2.dumps({"reader": token}))
    with closing(sqlite3.connect(folder / _STORE)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def read(folder: Path) -> dict[str, Any]:
    """Ask all about the skin, and bring frames and descriptions, some of them again."""
    secrets = cbor2.loads((folder / "secrets").read_bytes())
    with standing(folder, secrets["reader"]) as stand:
        return asyncio.run(_AskerOfSkin(stand, secrets).ask())


class _AskerOfSkin(Asker):
    async def ask(self) -> dict[str, Any]:
        """Ask everything; gives what was found."""
        for path in (f"nodes/{NODE}", f"nodes/{NODE}/layout"):
            self.keep(path, await self.get(path))
        for item in (await self.get(f"nodes/{NODE}/channels") or {}).get("items", ()):
            self.keep(f"channel {item['id']}", item)
        for channel in _CHANNELS:
            await self.ask_series(NODE, channel)
        for quantity in _QUANTITIES:
            for points in _PICTURES:
                await self._ask_pictures(quantity, points)
        await self._bring_again()
        return self.found

    async def _ask_pictures(self, quantity: str, points: int) -> None:
        path = f"nodes/{NODE}/frames"
        answer = await self.answer(path, quantity=quantity, points=points, **WINDOW)
        if answer is None or DAMAGED in answer.headers:
            return
        said = answer.json()
        begin = parse_timestamp(said["t0"])
        for t, lo, hi in zip(said["t"], said["lo"], said["hi"], strict=True):
            for taxel, *bounds in zip(said["taxels"], lo, hi, strict=True):
                if bounds != [None, None]:
                    self.found[f"{taxel} in {points} pictures at {begin + t}"] = bounds

    async def _bring_again(self) -> None:
        numbers = (0, _COMPACTED - 1, _COMPACTED, _COMPACTED + _FRESH - 1)
        for number in (*numbers, _COMPACTED + _FRESH):
            await self.bring(_said(number))
        async with self.stand.ingest_client() as client:
            body = batch(HAND, *PATCHES)
            answer = await client.post("/api/v1/descriptions", content=body)
        assert answer.status_code != 500, "500 at descriptions"
        if answer.status_code != 200:
            log.error("descriptions: %s", answer.json()["detail"])
            return
        for number, item in enumerate(answer.json()["items"]):
            if item["result"] not in {"stored", "duplicate"}:
                log.error("description %d: %s", number, item["reason"])


PART: Final = Part(
    make,
    read,
    (_STORE,),
    tuple(table.name for table in (frames, patch_rows, patch_tiles, descriptions, pages, patches)),
)
