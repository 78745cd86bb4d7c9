"""The lag of a node that seals what it measures is stated no closer than to its minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cbor2
import pytest

from eskin.wire.timestamp import SECOND
from tests.unit.cloud.messages import START, stretch
from tests.unit.cloud.sealing import NODE, Site, beat, declared, keyed, physician, pulse

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


@pytest.fixture
def stand(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site, place=place) as made:
        yield made


async def lag_of(stand: Stand) -> Any:
    async with stand.client(token=physician(stand)) as client:
        return (await client.get(f"/api/v1/nodes/{NODE}")).json()["lag"]


async def test_lag_of_a_node_that_seals_is_known_to_its_minutes(stand: Stand, site: Site) -> None:
    instant = START + 90 * SECOND
    stand.clock.now = instant + 5 * SECOND
    await stand.ingest(site.batch(declared(), beat(1, time=(instant, instant))))
    assert await lag_of(stand) is None, "a peak would tell when it came"
    await stand.ingest(site.batch(pulse(2, time=(instant, instant))))
    stated = await lag_of(stand)
    assert stated == {"lo_ns": -25 * SECOND, "hi_ns": 35 * SECOND}
    assert stated["lo_ns"] <= 5 * SECOND <= stated["hi_ns"]
    stand.clock.turn(7)
    await stand.ingest(site.batch(beat(3, time=(instant, instant))))
    assert await lag_of(stand) == stated


async def test_lag_of_a_block_in_the_clear_is_not_widened_by_sealed_ones(
    stand: Stand, site: Site
) -> None:
    instant = START + 90 * SECOND
    stand.clock.now = instant + 5 * SECOND
    await stand.ingest(site.batch(pulse(1, time=(instant, instant))))
    clear = stretch(2, [1.0], [2.0], time=(instant, instant), channel="t01.capacitance")
    await stand.ingest(cbor2.dumps([[NODE, clear.encode()]]))
    await stand.ingest(site.batch(pulse(3, time=(instant, instant))))
    assert await lag_of(stand) == {"lo_ns": 5 * SECOND, "hi_ns": 5 * SECOND}
