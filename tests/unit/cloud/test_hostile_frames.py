"""Frames, statements and descriptions that are wrong: each is refused, and harms no other."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import cbor2
import numpy as np
import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.schema.frame_tables import descriptions, frames
from eskin_cloud.store.schema.tables import dead_letters, lost_ranges
from eskin_cloud.store.write.ingest import REJECTED, STORED, UNKNOWN_LAYOUT, UNKNOWN_NODE

from eskin.interval import Interval, Verdict
from eskin.wire.frames import (
    Because,
    Contact,
    Frame,
    Layout,
    Link,
    MonitorVerdict,
    PatchSamples,
    Privacy,
    SampleCodes,
    Statements,
    content_hash,
)
from eskin.wire.messages import Kind
from eskin.wire.messages.cbor_map import MOST_BYTES, dump
from eskin.wire.timestamp import MOST_INSTANT
from tests.unit.cloud.clouds import batch, numbers, put
from tests.unit.cloud.messages import NODE, START, stretch
from tests.unit.cloud.skins import (
    FAST,
    HAND,
    PALM,
    PATCHES,
    TIP,
    WARM,
    describe,
    frame,
    layout,
    patch,
    statements,
)
from tests.unit.cloud.test_frames import results, rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import URL

    from tests.support.postgresql import Cluster
    from tests.unit.cloud.clouds import Stand

GOOD: Final = cbor2.loads(frame(1).encode())
WIDE: Final = patch("wide", 64)


def with_patch(at: int, value: Any, *, number: int = 0) -> bytes:
    """The good frame with another part of one of its patches."""
    patches = [list(each) for each in GOOD[9]]
    patches[number][at] = value
    return cbor2.dumps(GOOD | {9: patches})


def with_codes(change: Callable[[bytearray], None]) -> bytes:
    codes = bytearray(GOOD[9][0][6])
    change(codes)
    return with_patch(6, bytes(codes))


def set_width(codes: bytearray, width: int) -> None:
    codes[0] = width


def set_last_bit(codes: bytearray) -> None:
    codes[-1] |= 0x80


def beyond_the_limit() -> bytes:
    """A frame of few bytes that could take more than 64 KiB: samples that are all alike."""
    grid = FAST._replace(rows=1000)
    still = Interval(np.zeros((1000, 64)), np.ones((1000, 64)))
    packed = PatchSamples.pack(still, 64.0, patch=0, grid=0, first_row=grid.first_row)
    of_patch = packed.encode()
    assert len(cbor2.dumps(of_patch)) < MOST_BYTES // 20
    return cbor2.dumps(GOOD | {8: [list(grid)], 9: [of_patch]})


def sparse() -> bytes:
    """A frame of few samples in many cells: each patch has one row of a thousand."""
    grid = FAST._replace(rows=1000, first_row=0)
    values = Interval(np.zeros((1000, 64)), np.ones((1000, 64)))
    packed = [
        PatchSamples.pack(
            values, 64.0, patch=number, grid=0, first_row=0, strides=bytes([16]) * 64
        ).encode()
        for number in range(5)
    ]
    return cbor2.dumps(GOOD | {8: [list(grid)], 9: packed})


HOSTILE: Final = {
    "torn": frame(1).encode()[:-1],
    "longer than its patches": frame(1).encode() + b"\0",
    "codes end in a group": with_codes(lambda codes: codes.__delitem__(slice(-1, None))),
    "something after the codes": with_codes(lambda codes: codes.extend(b"\0")),
    "group of 25 bits": with_codes(partial(set_width, width=25)),
    "group of 255 bits": with_codes(partial(set_width, width=255)),
    "group wider than its codes": with_patch(6, b"\1\0" + GOOD[9][1][6][1:], number=1),
    "group is not filled up with zeros": with_codes(set_last_bit),
    "exponent too fine": with_patch(4, -1001),
    "exponent too coarse": with_patch(4, 931),
    "offset that a float does not hold": with_patch(5, 2**53),
    "offset beyond 64 bit": with_patch(5, 2**64 - 1),
    "no columns": with_patch(3, 0),
    "65 columns": with_patch(3, 65),
    "another column than codes": with_patch(3, 4),
    "grid that there is not": with_patch(1, 7),
    "patch twice": cbor2.dumps(GOOD | {9: [GOOD[9][0], GOOD[9][0]]}),
    "no patch": cbor2.dumps(GOOD | {9: []}),
    "no grid": cbor2.dumps(GOOD | {8: []}),
    "few bytes, many samples": beyond_the_limit(),
    "few samples, many cells": sparse(),
    "reversed time": cbor2.dumps(GOOD | {7: [2, 1]}),
    "indefinite length": frame(1).encode()[:-1] + b"\x5f\xff",
    "another order": cbor2.dumps(dict(reversed(GOOD.items()))),
    "unknown field": cbor2.dumps(GOOD | {10: 0}),
    "statements without any": cbor2.dumps(
        {1: int(Kind.STATEMENTS), 2: 1, 3: 1, 4: HAND.content_hash}
    ),
    "longer than a message": frame(1).encode() + bytes(MOST_BYTES),
    "a description": PALM.encode(),
}


@pytest.mark.anyio
@pytest.mark.parametrize("hostile", HOSTILE.values(), ids=HOSTILE)
async def test_what_is_no_frame_is_refused_without_its_bytes(
    stand: Stand, hostile: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    describe(stand.cloud.store, HAND, *PATCHES)
    body = cbor2.dumps([[NODE, each] for each in (frame(0).encode(), hostile, frame(2).encode())])
    answer = await stand.ingest(body)
    assert [item["result"] for item in answer.json()["items"]] == [STORED, REJECTED, STORED]
    assert all("want" not in item for item in answer.json()["items"])
    (letter,) = rows(stand.cloud.store, dead_letters)
    assert letter["data"] == b""
    assert len(rows(stand.cloud.store, frames)) == 2
    assert [each.levelname for each in caplog.records if "ingest" in each.name] == ["WARNING"]


@pytest.mark.anyio
async def test_description_goes_the_way_of_a_certificate(
    stand: Stand, caplog: pytest.LogCaptureFixture
) -> None:
    """Over HTTP: unknown layout, its description, and the frame again."""
    body = batch(frame(0), statements(1))
    (of_frame, of_statements) = (await stand.ingest(body)).json()["items"]
    assert of_frame["result"] == of_statements["result"] == UNKNOWN_LAYOUT
    assert not [each for each in caplog.records if each.levelname == "WARNING"], "it is usual"
    assert HAND.content_hash.hex() in of_frame["want"]
    described = {each.content_hash.hex(): each for each in (HAND, *PATCHES)}
    async with stand.ingest_client() as client:
        wanted = of_frame["want"]
        while wanted:
            presented = batch(*(described[name] for name in wanted))
            answer = await client.post("/api/v1/descriptions", content=presented)
            assert {item["result"] for item in answer.json()["items"]} <= {"stored", "duplicate"}
            first = (await stand.ingest(body)).json()["items"][0]
            wanted = first.get("want", [])
        assert first["result"] == STORED
        answer = await client.post("/api/v1/descriptions", content=batch(HAND))
        assert answer.json() == {"items": [{"result": "duplicate", "reason": None}]}
        elsewhere = await client.post("/api/v1/descriptions", content=batch(HAND, node="foreign"))
        assert elsewhere.json()["items"][0]["result"] == UNKNOWN_NODE
        for wrong in (b"\xa0", b"\x81", cbor2.dumps([[NODE, b""]] * 501), b""):
            refused = await client.post("/api/v1/descriptions", content=wrong)
            assert refused.status_code == 422
    async with stand.client() as client:
        assert (await client.post("/api/v1/descriptions", content=batch(HAND))).status_code in {
            404,
            405,
        }


@pytest.mark.anyio
async def test_invalid_description_harms_no_other(stand: Stand) -> None:
    body = cbor2.dumps([
        [NODE, b"\xa0"], [NODE, frame(0).encode()], [NODE], [NODE, "text"], ["No Node", b"\0"],
        [NODE, PALM.encode() + b"\0"], [NODE, bytes(MOST_BYTES + 1)], [NODE, HAND.encode()],
    ])  # fmt: skip
    stand.admitted.discard(NODE)
    await stand.ingest(batch(stretch(0)))
    async with stand.ingest_client() as client:
        answer = await client.post("/api/v1/descriptions", content=body)
    found = answer.json()["items"]
    assert [item["result"] for item in found] == [REJECTED] * 7 + [STORED]
    assert all(item["reason"] for item in found[:7])


def test_description_in_another_form_is_refused(store: Store) -> None:
    fields = cbor2.loads(PALM.encode())
    others: list[dict[int, object]] = [{11: []}, {9: []}, {6: 64}, {16: 0.0}]
    for changed in others:
        (result,) = describe(store, Raw(cbor2.dumps(dict(sorted((fields | changed).items())))))
        assert result.result == REJECTED
    assert not rows(store, descriptions)


class Raw:
    """Bytes instead of a message."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def encode(self) -> bytes:
        return self._data


@pytest.mark.parametrize(
    "change", [{8: "adalbert"}, {3: "voltage"}, {7: 0, 8: None}], ids=["name", "quantity", "public"]
)
def test_patch_that_names_a_person_or_contradicts_itself_is_refused_with_its_frames(
    store: Store, change: dict[int, Any]
) -> None:
    worn = patch(
        "heart", 1, quantity="bioelectric", unit="V", privacy=Privacy.BIOMETRIC, subject="wearer"
    )
    fields = {k: v for k, v in (cbor2.loads(worn.encode()) | change).items() if v is not None}
    data = dump(fields)
    of = Layout((content_hash(data),), (1,))
    stored, refused = describe(store, of, Raw(data))
    assert (stored.result, refused.result) == (STORED, REJECTED)
    (receipt,) = put(store, one_patch(of, sequence=0)).results
    assert receipt.result == REJECTED
    (letter,) = rows(store, dead_letters)
    assert letter["data"] == b""
    assert "adalbert" not in letter["reason"]
    assert [row["kind"] for row in rows(store, descriptions)] == ["layout"]
    assert [(row["first"], row["last"]) for row in rows(store, lost_ranges)] == [(0, 0)]


def one_patch(of: Any, *, sequence: int, columns: int = 1, epoch: int = 0, at: int = 0) -> Frame:
    still = Interval(np.zeros((1, columns)), np.ones((1, columns)))
    grid = FAST._replace(rows=1)
    packed = PatchSamples.pack(still, 64.0, patch=at, grid=0, first_row=grid.first_row, epoch=epoch)
    like = frame(sequence)
    return replace(like, layout=of.content_hash, grids=(grid,), patches=(packed,))


def test_what_does_not_fit_its_layout_is_a_dead_letter(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    good = statements(5)
    wrong: list[Frame | Statements] = [
        replace(frame(0), page=1),
        replace(frame(1, page=1), page=2),
        one_patch(HAND, sequence=2, columns=2),
        one_patch(HAND, sequence=3, columns=1, epoch=1, at=1),
        one_patch(HAND, sequence=4, at=1999),
        replace(good, peaks=(good.peaks[0]._replace(column=3),)),
        replace(statements(6), peaks=(good.peaks[0]._replace(patch=3),)),
        replace(statements(7), gaps=(good.gaps[0]._replace(patches=(0, 3)),)),
        replace(frame(8), time=(MOST_INSTANT - 10_000_000, MOST_INSTANT)),
    ]
    outcome = put(store, *wrong, frame(9), statements(10))
    assert results(outcome) == [REJECTED] * len(wrong) + [STORED] * 2
    assert all(receipt.reason for receipt in outcome.results[: len(wrong)])
    assert {row["data"] for row in rows(store, dead_letters)} == {each.encode() for each in wrong}
    lost = {(row["first"], row["last"]) for row in rows(store, lost_ranges) if row["boot"] == 1}
    assert lost == {(0, len(wrong) - 1)}


def test_patches_that_do_not_fit_their_layout_make_dead_letters(store: Store) -> None:
    twin = replace(patch("twin", 2), taxels=TIP.taxels)  # has the channels of another patch
    of = layout((TIP, twin), (2,))
    describe(store, of, TIP, twin, HAND, *PATCHES)
    outcome = put(store, one_patch(of, sequence=0, columns=2), frame(1))
    assert results(outcome) == [REJECTED, STORED]


def test_channel_keeps_its_unit(store: Store) -> None:
    describe(store, HAND, *PATCHES)
    assert (
        results(put(store, frame(0), stretch(1, channel="tip-0.force", unit="N"))) == [STORED] * 2
    )
    colder = patch("warm", 1, quantity="temperature", unit="K")
    stronger = patch("tip", 2, quantity="force", unit="mN")
    for sequence, other in ((2, (PALM, colder, TIP)), (3, (PALM, WARM, stronger))):
        of = layout(other)
        describe(store, of, *other)
        outcome = put(store, frame(sequence, of=of))
        assert results(outcome) == [REJECTED]
        assert "keeps its unit" in str(outcome.results[0].reason)
    store.clear_caches()
    assert results(put(store, frame(4, of=layout((PALM, colder, TIP))), frame(5))) == [
        REJECTED,
        STORED,
    ]
    alike = layout((PALM, WARM, patch("tip", 2, quantity="force", unit="N")))
    describe(store, alike, patch("tip", 2, quantity="force", unit="N"))
    assert results(put(store, frame(6, of=alike), frame(0))) == [STORED, "duplicate"]


def test_channel_keeps_its_unit_whichever_cloud_stored_it_first(
    cluster: Cluster, shared_database: URL
) -> None:
    cluster.clear(shared_database)
    colder = (PALM, patch("warm", 1, quantity="temperature", unit="K"), TIP)
    other = layout(colder)
    with Store(shared_database) as one, Store(shared_database) as two:
        describe(one, HAND, *PATCHES)
        describe(one, other, *colder)
        # Read by its layout, of which nothing is stored then.
        assert results(put(one, one_patch(other, sequence=0, columns=2))) == [REJECTED]
        assert results(put(two, frame(1))) == [STORED]
        assert results(put(one, frame(2, of=other), frame(3))) == [REJECTED, STORED]


def test_channels_of_all_layouts_of_a_node_count(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.store.write.layouts.MOST_CHANNELS", 9)
    describe(store, HAND, *PATCHES)  # 6 channels
    assert results(put(store, frame(0), stretch(1))) == [STORED] * 2  # 7
    third, fourth = patch("third", 2), patch("fourth", 1)
    many, fits = layout((third, fourth), (2,)), layout((third, PALM), (2,))
    describe(store, many, fits, third, fourth)
    said = [
        one_patch(many, sequence=2, columns=2),  # 10
        one_patch(fits, sequence=3, columns=2),  # 9
    ]
    for _ in range(2):
        outcome = put(store, *said)
        assert results(outcome)[0] == REJECTED
        assert "at most 9" in str(outcome.results[0].reason)
        assert results(outcome)[1] in {STORED, "duplicate"}
        store.clear_caches()
    assert results(put(store, frame(4), stretch(5))) == [STORED] * 2
    outcome = put(store, stretch(6, channel="t02.pressure", unit="Pa"))
    assert results(outcome) == [REJECTED]
    assert "at most 9" in str(outcome.results[0].reason)


def test_descriptions_of_a_node_are_limited(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin_cloud.store.descriptions.MOST_DESCRIPTIONS", 4)
    assert {each.result for each in describe(store, HAND, *PATCHES)} == {STORED}
    assert [each.result for each in describe(store, WIDE, HAND)] == [REJECTED, "duplicate"]
    assert [each.result for each in describe(store, WIDE, node="palm")] == [STORED]
    assert results(put(store, frame(0))) == [STORED]


def test_contacts_and_verdicts_become_events(stand: Stand) -> None:
    store = stand.cloud.store
    describe(store, HAND, *PATCHES)
    contact = Contact(
        7, (START, START + 1), Verdict.CERTAIN, (1, 2), (1, 3), (0.5, np.inf),
        ((0.0, 0.01), (-0.25, 0.5)), 0.99, (Link(6, Verdict.POSSIBLE),),
    )  # fmt: skip
    unsure = Because.GAP | Because.WIDTH
    verdicts = (
        MonitorVerdict(
            "grip", (START,) * 2, Verdict.POSSIBLE, final=False, because=unsure, coverage=1.0
        ),
        MonitorVerdict(
            "slip", (START,) * 2, Verdict.IMPOSSIBLE, final=True, because=Because(0), coverage=0.5
        ),
    )
    said = replace(statements(0), peaks=(), gaps=(), contacts=(contact,), verdicts=verdicts)
    outcome = put(store, said)
    assert results(outcome) == [STORED]
    assert numbers(entry.cursor for entry in outcome.entries) == [1, 2, 3]
    listed = [entry.event for entry in outcome.entries if entry.event is not None]
    assert [(row["kind"], row["verdict"]) for row in listed] == [
        ("contact", "certain"),
        ("verdict", "possible"),
        ("verdict", "impossible"),
    ]


@pytest.mark.anyio
async def test_events_of_statements_are_listed(stand: Stand) -> None:
    test_contacts_and_verdicts_become_events(stand)
    found = (await stand.get("/api/v1/events", kind="contact")).json()["items"]
    (contact,) = found
    assert contact["count"] == {"lo": 1, "hi": 2}
    assert contact["detail"] == (
        '{"label":7,"cells":[1,3],"force":[0.5,null],"centroid":[[0.0,0.01],[-0.25,0.5]],'
        '"links":[{"contact":6,"verdict":"possible"}]}'
    )
    (slip,) = (await stand.get("/api/v1/events", verdict="impossible")).json()["items"]
    assert slip["detail"] == '{"monitor":"slip","final":true,"because":[]}'
    (grip,) = (await stand.get("/api/v1/events", kind="verdict", verdict="possible")).json()[
        "items"
    ]
    assert grip["detail"] == '{"monitor":"grip","final":false,"because":["width","gap"]}'


def test_codes_are_checked_before_their_layout_is_known(store: Store) -> None:
    """A gateway is not asked for the layout of what is no frame."""
    packed = frame(0).patches[0]
    spoiled = replace(packed, samples=SampleCodes(0, 0, b"\x19"))
    fields = cbor2.loads(frame(0).encode())
    fields[9][0] = spoiled.encode()
    assert results(put(store, Raw(cbor2.dumps(fields)))) == [REJECTED]
