"""What identifies a person is stored sealed, and answers readers with the scope like all else."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import cbor2
import numpy as np
import pytest
from eskin_cloud.store.schema.tables import dead_letters
from eskin_cloud.store.write.ingest import count_dead_letters
from sqlalchemy import select

from eskin.interval import Verdict
from eskin.wire.timestamp import SECOND, format_timestamp
from tests.unit.cloud.clouds import problem
from tests.unit.cloud.messages import DT, START, peak, stretch, tube_of
from tests.unit.cloud.sealing import (
    CHANNEL,
    NODE,
    Site,
    ask,
    beat,
    declared,
    kept,
    keyed,
    physician,
    pulse,
    remains,
    sealing,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from eskin.wire.frames import Frame, Statements
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
EMPTY = {"start": START + 100 * DT, "end": START + 100 * DT}
WIDE = {"start": START - SECOND, "end": START + 3600 * SECOND}


@pytest.fixture
def stand(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site, place=place) as made:
        yield made


def is_beat(said: Statements) -> bool:
    return said.layout == beat(0).layout


def wave(sequence: int) -> Any:
    rng = np.random.default_rng(sequence)
    lo = rng.normal(size=40)
    instant = START + sequence * 40 * DT
    return pulse(sequence, lo, lo + rng.random(40), time=(instant, instant + 200))


async def test_every_answer_encloses_what_was_sealed(stand: Stand, site: Site) -> None:
    token = physician(stand)
    waves = [wave(number) for number in range(1, 6)]
    await stand.ingest(site.batch(declared(), *waves))
    answer = (await ask(stand, token, SERIES, **WIDE, points=4)).json()
    for stated in waves:
        tube = tube_of(stated)
        for instant, lo, hi in zip(tube.instants, tube.values.inf, tube.values.sup, strict=True):
            at = (int(instant) - START + SECOND) // answer["dt"]
            assert answer["lo"][at] <= lo <= hi <= answer["hi"][at]


async def test_reader_without_the_scope_is_refused_with_the_reason(
    stand: Stand, site: Site
) -> None:
    await stand.ingest(site.batch(declared(), pulse(1), beat(2)))
    for path, params in (
        (SERIES, {}),
        (f"{SERIES}/threshold", {"above": 0.0}),
        (f"{SERIES}/comparison", {"other": f"{NODE}/{CHANNEL}"}),
        (f"{SERIES}/anomalies/time", {"model": "constant", "parameter": "value:0:1"}),
        ("/api/v1/events", {"channel": CHANNEL}),
        ("/api/v1/live", {"channel": f"{NODE}/{CHANNEL}"}),
    ):
        said = problem(await stand.get(path, **params), 403)
        assert "scope biometric" in said
    listed = (await stand.get("/api/v1/events")).json()["items"]
    assert [item for item in listed if item["kind"] == "peak"] == []
    (channel,) = (await stand.get(f"/api/v1/nodes/{NODE}/channels")).json()["items"]
    assert (channel["first"], channel["last"], channel["removed"]) == (None, None, None)


async def test_cloud_without_keys_says_so(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> None:
    with sealing(tmp_path, identities, place=place, keys=False) as stand:
        await stand.ingest(site.batch(declared(), pulse(1)))
        said = problem(await ask(stand, physician(stand), SERIES), 403)
    assert "holds no keys" in said


async def test_sealed_message_is_stored_once(stand: Stand, site: Site) -> None:
    sealed = [site.batch(pulse(1), beat(2)) for _ in range(2)]
    results = [(await stand.ingest(body)).json()["items"] for body in sealed]
    assert [[item["result"] for item in items] for items in results] == [
        ["stored", "stored"],
        ["duplicate", "duplicate"],
    ]


@pytest.mark.parametrize("channel", [CHANNEL, "bio-sole.pressure"])
async def test_biometric_frame_in_the_clear_is_refused_and_none_of_it_is_kept(
    stand: Stand, tmp_path: Path, channel: str
) -> None:
    stated: list[Frame | Statements] = [
        pulse(1, [1.2345678], [2.3456789], channel=channel),
        beat(2, channel=channel),
    ]
    stored = await stand.ingest(cbor2.dumps([[NODE, message.encode()] for message in stated]))
    assert {item["result"] for item in stored.json()["items"]} == {"rejected"}
    with stand.cloud.store.read() as connection:
        assert connection.execute(select(dead_letters.c.data)).scalars().all() == [b""]
        assert count_dead_letters(connection) == 1
    held = remains(tmp_path) + kept(stand.cloud.store)
    assert all(message.encode()[-24:] not in held for message in stated)


async def test_channel_that_is_not_biometric_cannot_be_sealed(stand: Stand, site: Site) -> None:
    items = (await stand.ingest(site.batch(stretch(1), peak(2)))).json()["items"]
    assert {item["result"] for item in items} == {"rejected"}


async def test_sealed_peaks_stand_among_the_events_page_by_page(stand: Stand, site: Site) -> None:
    token = physician(stand)
    rng = np.random.default_rng(5)
    instants = START + np.sort(rng.integers(0, 200, 60)) * SECOND
    stated: list[Any] = []
    for number, instant in enumerate(instants.tolist(), start=1):
        time = (instant, instant + DT)
        judged = Verdict.CERTAIN if number % 3 else Verdict.POSSIBLE
        stated.append((beat if number % 2 else peak)(number, time=time, verdict=judged))
    shuffled = [stated[index] for index in rng.permutation(60)]
    bodies = [site.seal(m) if is_beat(m) else m.encode() for m in shuffled]
    stand.present(cbor2.dumps([[NODE, m.encode()] for m in stated]))
    await stand.ingest(cbor2.dumps([[NODE, body] for body in bodies]))
    for order in ("asc", "desc"):
        for verdict in (None, "certain"):
            asked: dict[str, Any] = {"kind": "peak", "limit": 7, "order": order}
            asked |= {} if verdict is None else {"verdict": verdict}
            pages: list[Any] = []
            seen: list[Any] = []
            while not pages or pages[-1]["next"]:
                cursor = {"cursor": pages[-1]["next"]} if pages else {}
                pages.append((await ask(stand, token, "/api/v1/events", **asked, **cursor)).json())
                seen += pages[-1]["items"]
            wanted = [m for m in stated if verdict is None or m.peaks[0].verdict is Verdict.CERTAIN]
            assert len({item["id"] for item in seen}) == len(seen) == len(wanted)
            assert sorted(item["time"]["lo"] for item in seen) == sorted(
                format_timestamp(m.peaks[0].time[0]) for m in wanted
            )
            times = [item["time"]["lo"] for item in seen]
            assert all(a <= b if order == "asc" else a >= b for a, b in pairwise(times))
    inside = {"start": START + 50 * SECOND, "end": START + 90 * SECOND, "channel": CHANNEL}
    found = (await ask(stand, token, "/api/v1/events", **inside, limit=100)).json()["items"]
    times = [m.peaks[0].time for m in stated if is_beat(m)]
    lasting = [time for time in times if time[1] >= inside["start"]]
    assert len(found) == sum(start < inside["end"] for start, _ in lasting)
    for start, _ in lasting[:2]:
        instant = {"start": start + 1, "end": start + 1}
        assert (await ask(stand, token, "/api/v1/events", **instant)).json()["items"] == []
