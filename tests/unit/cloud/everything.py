"""A store with something in every table."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_cloud.access import create_login_code
from eskin_cloud.alarms.receivers import register_receiver
from eskin_cloud.jobs.missing_messages import look
from eskin_cloud.rollup.patch_tile_builder import build

from eskin.interval import Verdict
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.brute_force import compact_all, remove_before
from tests.unit.cloud.clouds import batch, put
from tests.unit.cloud.live_monitors import Live, alarms_of, define
from tests.unit.cloud.messages import DT, START, gap, peak, status, stretch, verdict
from tests.unit.cloud.orders import order
from tests.unit.cloud.sealing import NODE as HAND
from tests.unit.cloud.sealing import beat, declared, notice, pulse
from tests.unit.cloud.skins import HAND as HAND_LAYOUT
from tests.unit.cloud.skins import PATCHES, describe, frame, statements

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from tests.unit.cloud.clouds import Stand
    from tests.unit.cloud.sealing import Site

PACKED: Final = "t02.capacitance"
BUILT: Final = "t03.capacitance"


async def fill(stand: Stand, site: Site) -> None:
    """Have all come that a cloud keeps; it holds keys."""
    store = stand.cloud.store
    spoiled = stretch(4, unit="H")  # becomes a dead letter
    await stand.ingest(batch(status(0), peak(1), gap(2), stretch(3), spoiled))
    await stand.ingest(batch(verdict(5, ("squeeze", Verdict.CERTAIN))))
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
    _raise(store)


def _pack(store: Store) -> None:
    values = [1.0] * 100, [2.0] * 100
    instants = [START + 100 * k * DT for k in range(64)]
    said = partial(stretch, channel=PACKED)
    put(store, *(said(100 + k, *values, time=(t, t)) for k, t in enumerate(instants)))
    compact_all(store)


def _build(store: Store) -> None:
    said = partial(stretch, dt=1, channel=BUILT)
    instants = [START + 20_000 * k for k in range(5)]
    put(store, *(said(200 + k, time=(t, t)) for k, t in enumerate(instants)))
    compact_all(store)
    build(store)
    put(store, said(299, time=(START + 50, START + 50)))  # late
    compact_all(store)


def _raise(store: Store) -> None:
    define(store, f"{PACKED} > 0.5", since=START)
    live = Live(store)
    store.write_and_wait(lambda connection: register_receiver(connection, "webhook ops"))
    live.step()
    live.step()
    assert alarms_of(store)
