"""Limits of channels, ranges and cached rows of a node."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store.write.ingest import DUPLICATE, REJECTED, STORED

from tests.unit.cloud.clouds import batch, cached_rows, put
from tests.unit.cloud.messages import NODE, peak, status, stretch
from tests.unit.cloud.sealing import NODE as HAND
from tests.unit.cloud.sealing import Site, declared, pulse, sealing

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.write.ingest import IngestResult

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

CHANNELS = tuple(f"t{number:02}.capacitance" for number in range(1, 6))


def results(outcome: IngestResult) -> list[str]:
    return [receipt.result for receipt in outcome.results]


def test_channels_of_a_node_are_limited(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.layouts.MOST_CHANNELS", 3)
    store = stand.cloud.store
    said = [stretch(number, channel=name) for number, name in enumerate(CHANNELS)]
    outcome = put(store, *said)
    assert results(outcome) == [STORED] * 3 + [REJECTED] * 2
    assert "at most 3 are allowed" in str(outcome.results[-1].reason)
    store.clear_caches()
    assert results(put(store, stretch(10, channel=CHANNELS[3]))) == [REJECTED]
    assert results(put(store, peak(12, channel=CHANNELS[4]))) == [REJECTED]
    assert results(put(store, stretch(13), peak(14), status(15))) == [STORED] * 3
    assert results(put(store, stretch(0, channel=CHANNELS[4]), node="palm")) == [STORED]


@pytest.mark.anyio
async def test_sealed_channels_count(
    tmp_path: Path, identities: Identities, place: StoreLocation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.layouts.MOST_CHANNELS", 2)
    site = Site(tmp_path)
    with sealing(tmp_path, identities, place=place) as stand:
        stated = [pulse(n, channel=f"t{n:02}.bioelectric") for n in range(6, 9)]
        answer = await stand.ingest(site.batch(declared(), *stated))
        assert [item["result"] for item in answer.json()["items"]] == [
            STORED,
            STORED,
            STORED,
            REJECTED,
        ]
        listed = (await stand.get(f"/api/v1/nodes/{HAND}/channels")).json()["items"]
        assert len(listed) == 2


def test_ranges_of_a_boot_are_limited(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.duplicates.MAX_RANGES", 3)
    store = stand.cloud.store
    outcome = put(store, *(stretch(number) for number in (0, 2, 4, 6, 4)), peak(8))
    assert results(outcome) == [STORED] * 3 + [REJECTED, DUPLICATE, REJECTED]
    assert "gaps" in str(outcome.results[3].reason)
    store.clear_caches()
    assert results(put(store, stretch(8))) == [REJECTED]
    assert results(put(store, stretch(5), peak(6))) == [STORED] * 2, "these leave no other hole"
    assert results(put(store, stretch(1), stretch(9))) == [STORED] * 2, "one hole was filled"
    assert results(put(store, stretch(11), stretch(11, boot=2))) == [REJECTED, STORED]


@pytest.mark.anyio
async def test_rejected_messages_leave_no_cache_entry(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.layouts.MOST_CHANNELS", 1)
    monkeypatch.setattr("eskin_cloud.store.write.write_cache._MAX_ROWS", 5)
    monkeypatch.setattr("eskin_cloud.store.write.write_cache._MAX_BOOTS", 5)
    assert (await stand.ingest(batch(stretch(0)))).status_code == 200
    for number in range(30):
        refused = stretch(0, boot=2 + number, channel=f"t{number:02}.pressure")
        answer = await stand.ingest(batch(refused))
        assert [item["result"] for item in answer.json()["items"]] == [REJECTED]
        assert cached_rows(stand.cloud.store) <= 13
    assert results(put(stand.cloud.store, stretch(0), stretch(1), node=NODE)) == [DUPLICATE, STORED]
