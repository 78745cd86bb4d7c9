"""A store with something in every table."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Final

from eskin_cloud.access import create_login_code
from eskin_cloud.jobs.missing_messages import look
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store.compaction import compact_page
from eskin_cloud.store.row_digests import ROW_DIGEST
from eskin_cloud.store.schema.frame_tables import (
    patch_rows,
    patch_tiles,
    patches,
    stale_patch_chunks,
)
from eskin_cloud.store.text_type import Text
from sqlalchemy import BigInteger, Double, Integer, LargeBinary, insert

from eskin.wire.messages import Encoding
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.brute_force import remove_before
from tests.unit.cloud.clouds import batch, put
from tests.unit.cloud.messages import DT, NODE, START, block, gap, peak, status
from tests.unit.cloud.orders import order
from tests.unit.cloud.sealing import NODE as HAND
from tests.unit.cloud.sealing import beat, declared, notice, pulse
from tests.unit.cloud.skins import HAND as HAND_LAYOUT
from tests.unit.cloud.skins import PATCHES, describe, frame, statements

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from sqlalchemy import Connection

    from tests.unit.cloud.clouds import Stand
    from tests.unit.cloud.sealing import Site

PACKED: Final = "t02.capacitance"
BUILT: Final = "t03.capacitance"
_VALUES: Final = {BigInteger: 2**40, Double: -inf, Integer: 7, LargeBinary: b"\0\1", Text: "a"}


async def fill(stand: Stand, site: Site) -> None:
    """Have all come that a cloud keeps; it holds keys."""
    store = stand.cloud.store
    spoiled = block(4, unit="H")  # becomes a dead letter
    await stand.ingest(batch(status(0), peak(1), gap(2), block(3), spoiled))
    bo = site.keystore.create("Bo")
    await stand.ingest(batch(replace(status(0, boot=2), ended=((1, 999),))))
    await look(stand.cloud)
    worn = [[each.pseudonym, HAND, each.key] for each in (site.ada, bo)]
    await notice(stand, worn, [bo.pseudonym])
    await stand.ingest(site.batch(declared(), pulse(1), beat(2)))
    await order(stand, {"name": "set", "arguments": {"rate": 500}})
    create_login_code(store, lifetime=timedelta(days=1))
    async with stand.client(token="") as browser:
        await browser.post("/login", data={"token": stand.token})
    remove_before(store, START + SECOND)
    _pack(store)
    _build(store)
    describe(store, HAND_LAYOUT, *PATCHES, node=HAND)
    put(store, frame(300), frame(301, page=1), statements(302), node=HAND)
    store.write_and_wait(_insert_derived)


def _insert_derived(connection: Connection) -> None:
    """One row in each table that is made of frames."""
    for table in (patches, patch_rows, patch_tiles, stale_patch_chunks):
        values = {
            column.name: _VALUES[type(column.type)]
            for column in table.columns
            if column.name != ROW_DIGEST
        }
        connection.execute(insert(table), values)


def _pack(store: Store) -> None:
    values = [1.0] * 100, [2.0] * 100
    moments = [START + 100 * k * DT for k in range(64)]
    said = partial(block, channel=PACKED, encoding=Encoding.Q16)
    put(store, *(said(100 + k, *values, time=(t, t)) for k, t in enumerate(moments)))
    while compact_page(store, (NODE, PACKED), behind=0):
        pass


def _build(store: Store) -> None:
    moments = [START + 20_000 * k for k in range(5)]
    put(store, *(block(200 + k, time=(t, t), dt=1, channel=BUILT) for k, t in enumerate(moments)))
    build(store)
    put(store, block(299, time=(START + 50, START + 50), dt=1, channel=BUILT))  # late
