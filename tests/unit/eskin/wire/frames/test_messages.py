"""Patches, layouts, frames and statements come back as they went; all else is a `MessageError`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cbor2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.interval import Interval, Verdict
from eskin.wire.frames import (
    Because,
    EncodedFrame,
    Frame,
    Gap,
    Grid,
    Layout,
    MonitorVerdict,
    Patch,
    PatchSamples,
    Sampling,
    Statements,
)
from eskin.wire.messages import Position
from eskin.wire.messages.cbor_map import MOST_BYTES, dump
from tests.unit.eskin.wire.frames.examples import (
    AIR,
    FAST,
    FRAME,
    LAYOUT,
    MESSAGES,
    PALM,
    PATCHES,
    PRESSED,
    STATEMENTS,
    WEARER,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Message = Patch | Layout | Frame | Statements


def named(message: object) -> str:
    return type(message).__name__


@pytest.mark.parametrize("message", MESSAGES, ids=named)
def test_message_comes_back_equal_and_byte_for_byte(message: Message) -> None:
    data = message.encode()
    back = type(message).decode(data)
    assert back == message
    assert back.encode() == data


def test_frame_encloses_what_it_was_given() -> None:
    values = Frame.decode(FRAME.encode()).values[0]
    mask = FRAME.patches[0].sampling(FAST).mask
    assert mask.tolist() == [[True, True, True], [True, False, True], [True, True, True]]
    assert np.all(values.inf[mask] <= PRESSED.inf[mask])
    assert np.all(values.sup[mask] >= PRESSED.sup[mask])
    assert np.all(values.inf[mask] >= PRESSED.inf[mask] - 1.0)


@pytest.mark.parametrize(
    "changes",
    [[1 << bit for bit in range(8)], pytest.param(range(256), marks=pytest.mark.nightly)],
    ids=["bit", "byte"],
)
@pytest.mark.parametrize("message", MESSAGES, ids=named)
def test_every_changed_byte_is_refused_or_another_message(
    message: Message, changes: Sequence[int]
) -> None:
    good = message.encode()
    for place in range(len(good)):
        for change in changes:
            changed = good[:place] + bytes([good[place] ^ change]) + good[place + 1 :]
            try:
                found = type(message).decode(changed)
            except MessageError:
                continue
            assert found.encode() == changed


@pytest.mark.parametrize("message", MESSAGES, ids=named)
def test_cut_or_prolonged_messages_are_refused(message: Message) -> None:
    good = message.encode()
    for wrong in (*(good[:k] for k in range(len(good))), good + b"\0", good + good):
        with pytest.raises(MessageError):
            type(message).decode(wrong)


@pytest.mark.parametrize("message", MESSAGES, ids=named)
def test_other_encodings_of_the_same_message_are_refused(message: Message) -> None:
    fields = cbor2.loads(message.encode())
    backwards = cbor2.dumps(dict(reversed(fields.items())))
    longer = message.encode()[:2] + b"\x18" + message.encode()[2:]
    for wrong in (backwards, longer):
        with pytest.raises(MessageError):
            type(message).decode(wrong)


@pytest.mark.parametrize("message", MESSAGES, ids=named)
def test_missing_and_unknown_fields_are_refused(message: Message) -> None:
    fields = cbor2.loads(message.encode())
    required = {Patch: 7, Layout: 3, Frame: 9, Statements: 4}[type(message)]
    for key in range(1, required + 1):
        with pytest.raises(MessageError):
            type(message).decode(dump({k: v for k, v in fields.items() if k != key}))
    with pytest.raises(MessageError):
        type(message).decode(dump(fields | {17: 1}))


OPTIONS = {1: bytes((0, 1, 0)), 2: b"\x04"}
WRONG: list[tuple[Message, dict[int, Any]]] = [
    *((PALM, {key: value}) for key, value in [
        (2, "Palm"), (2, ""), (3, "Pressure"), (4, ""), (4, "x" * 17), (5, []), (5, ["t00"] * 3),
        (5, ["t0", "t1"]), (5, ["T0", "t1", "t2"]), (5, [f"t{k}" for k in range(65)]), (6, 0.0),
        (6, -1.0), (6, float("inf")), (6, 64), (7, 2), (7, 1), (8, "wearer"), (9, []),
        (9, [[0, 1, 2]]), (9, [[0, 1, 2]] * 4), (9, [[0, 1], [0, 1]]), (9, [[0, 1, 10**9]] * 2),
        (10, b""), (10, b"\0"), (10, b"\1\0"), (10, b"\0\0"), (10, b"\0\1\0\1"), (10, b"\1\2\0\1"),
        (10, b"\0\3"), (11, [0, 0, 0]), (11, [0, -1, 5]), (11, [0, 1]), (12, []), (12, [[0.5]]),
        (12, [[0.9, 1.1]] * 2), (12, [[0.9, 1.1]] * 3), (12, [[1.1, 0.9]]), (12, [[-1.0, 1.0]]),
        (12, [[0.5, float("inf")]]), (13, [[float("nan"), 1.0]]), (14, 0.0),
        (15, float("inf")), (15, 0.0),
        (16, -1.0),
    ]),
    (AIR, {12: [[1.0, 2.0]]}), (AIR, {7: 1}), (AIR, {7: 1, 8: "wearer"}),
    (AIR, {3: "bioelectric"}), (AIR, {5: ["bio-a"]}), (WEARER, {8: "ada"}),
    (WEARER, {8: "wearer-2"}),
    (WEARER, {3: "voltage"}), (WEARER, {7: 0}),
    *((LAYOUT, {key: value}) for key, value in [
        (2, b""), (2, bytes(32)), (2, bytes(96)), (2, b"\1" * 33), (3, [3, 1]), (3, [2, 1, 0]),
        (3, []),
        (3, [True, 2]), (4, []), (4, [[1, 0, b"\0\0"]]), (4, [[0, 3, b"\0\0"]]),
        (4, [[0, 1, b"\0"]]),
        (4, [[0, 1, b"\0\0"]] * 2), (4, [[0, 2, b"\0\0"], [0, 1, b"\0\0"]]),
        (4, [[0, 1, b"\0\x40"]]),
        (5, [["hand", 1]]), (5, [["hand", 3]]), (5, [["", 2]]), (5, [["hand"]]),
        (6, []), (6, [[]]), (6, [[[0, 1, 2]]]), (6, [[[0, 1]] * 2]), (6, [[[0, 1, 2], [0, 1]]]),
        (6, [[[0, 1, 10**9]] * 2]), (6, [[[0] * 501] * 2]), (6, [[[0, 1, 0.5]] * 2]),
        (6, [[[0, 1, 2]] * 2] * 17),
    ]),
    *((FRAME, {key: value}) for key, value in [
        (1, 2), (2, -1), (3, 2**53), (4, bytes(31)), (4, "x"), (5, 256), (6, -1), (6, 2**63),
        (7, [2, 1]),
        (7, [1]),
        (8, []), (8, [list(FAST)]), (8, [list(FAST)] * 2), (8, [list(FAST)] * 3), (9, []),
        (9, [[]]),
    ]),
    *((STATEMENTS, {key: value}) for key, value in [
        (4, b""), (5, []), (6, []), (7, []), (8, []), (5, [[0, 1, [5, 9]]]),
        (5, [[0, 64, [5, 9], 2, [1, 1], [1.0, 1.5], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [9, 5], 2, [1, 1], [1.0, 1.5], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [5, 9], 2, [0, 1], [1.0, 1.5], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [5, 9], 1, [1, 1], [1.0, 1.5], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [5, 9], 0, [0, 1], [1.0, 1.5], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [5, 9], 2, [1, 1], [1.5, 1.0], [0.5, 1.0], 0.999]]),
        (5, [[0, 1, [5, 9], 2, [1, 1], [1.0, 1.5], [0.5, 1.0], 1.5]]),
        (6, [[7, [5, 6], 2, [1, 2], [1, 3], [0.5, 1.5], [[0.0, 1.0]], 1.0, []]]),
        (6, [[7, [5, 6], 2, [1, 2], [3, 1], [0.5, 1.5], [[0.0, 1.0]] * 2, 1.0, []]]),
        (6, [[7, [5, 6], 2, [1, 2], [1, 3], [0.5, 1.5], [[0.0, 1.0]] * 2, 1.0, [[1, 0]]]]),
        (7, [["grip", [5, 6], 1, False, 0, 1.0]]), (7, [["grip", [5, 6], 2, False, 1, 1.0]]),
        (7, [["grip", [5, 6], 1, True, 8, 1.0]]), (7, [["grip", [5, 6], 1, 0, 1, 1.0]]),
        (7, [["grip", [5, 6], 1, False, 16, 1.0]]), (7, [["Grip", [5, 6], 2, True, 0, 1.0]]),
        (8, [["", [1, 2], 7, 1, [], []]]), (8, [["full", [1, 2], 7, 1, [], [1, 0]]]),
        (8, [["full", [1, 2], 7, 1, [], [2000]]]), (8, [["full", [1, 2], 7, 1, [[1, 2, 1]], []]]),
    ]),
]  # fmt: skip


@pytest.mark.parametrize(("message", "change"), WRONG, ids=lambda each: named(each)[:1])
def test_values_that_are_out_of_range_are_refused(message: Message, change: dict[int, Any]) -> None:
    with pytest.raises(MessageError):
        type(message).decode(dump(cbor2.loads(message.encode()) | change))


SAMPLES = cbor2.loads(FRAME.encode())[9]
CODES = SAMPLES[1][6]


@pytest.mark.parametrize(
    "change",
    [
        {0: 2000}, {0: -1}, {1: 2}, {1: 0}, {2: -1}, {2: 2**53}, {3: 0}, {3: 65}, {3: 2},
        {4: -1001},
        {4: 931}, {5: 2**53}, {5: -(2**53)}, {5: 0.0}, {6: b""}, {6: CODES + b"\0"},
        {6: CODES[:-1]},
        {6: "x"}, {6: b"\x19" + CODES[1:]}, {6: bytes(70_000)},
        {7: {}}, {7: []}, {7: {3: b"\0"}}, {7: {1: b"\0"}}, {7: {1: b"\x11"}}, {7: {1: b"\0\1"}},
        {7: {1: b"\x10"}}, {7: {2: b"\1"}}, {7: {2: b"\0"}}, {7: {2: b"\2"}}, {7: {1: 5}},
    ],
)  # fmt: skip
def test_samples_that_contradict_themselves_are_refused(change: dict[int, Any]) -> None:
    slow = [change.get(k, value) for k, value in enumerate([*SAMPLES[1], None])]
    changed = slow if 7 in change else slow[:7]
    with pytest.raises(MessageError):
        Frame.decode(dump(cbor2.loads(FRAME.encode()) | {9: [SAMPLES[0], changed]}))


@pytest.mark.parametrize(
    "options",
    [{2: b"\x04", 1: bytes((0, 1, 0))}, {True: bytes((0, 1, 0))}, {1.0: bytes((0, 1, 0))}],
)
def test_options_have_one_form(options: dict[Any, bytes]) -> None:
    """Python finds 1, 1.0 and True alike, and keeps the order in which a map was written."""
    with pytest.raises(MessageError):
        Frame.decode(
            dump(cbor2.loads(FRAME.encode()) | {8: [list(FAST)], 9: [[*SAMPLES[0][:7], options]]})
        )


@pytest.mark.parametrize("order", [(1, 0), (0, 0), (1,), (0,)])
def test_patches_and_grids_stand_in_their_only_order(order: tuple[int, ...]) -> None:
    with pytest.raises(MessageError):
        Frame.decode(dump(cbor2.loads(FRAME.encode()) | {9: [SAMPLES[k] for k in order]}))


@settings(deadline=None, max_examples=30)
@given(
    shapes=st.lists(st.tuples(st.integers(1, 64), st.booleans()), min_size=1, max_size=40),
    rows=st.integers(1, 30),
    seed=st.integers(0, 2**32),
)
def test_frame_of_any_values_is_no_longer_than_its_limit(
    shapes: list[tuple[int, bool]], rows: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    most = 2**53 - 1
    grid = Grid(10**12, 10**12, most, rows, 0.5)
    patches = []
    for k, (columns, is_strided) in enumerate(shapes):
        values = Interval(random.uniform(-1e15, 1e15, (rows, columns)))
        strides = bytes((1, *bytes(columns - 1))) if is_strided and columns > 1 else b""
        unshared = tuple(range(columns))
        patches.append(
            PatchSamples.pack(
                values, 1e-15, patch=1500 + k, grid=0, first_row=most, epoch=most,
                strides=strides, unshared=unshared,
            )
        )  # fmt: skip
    instants = (2**63 - 2, 2**63 - 1)
    try:
        frame = Frame(Position(most, most), bytes(32), 255, most, instants, (grid,), tuple(patches))
    except MessageError:
        bytes_of_codes = [Sampling(rows, c, most).limit for c, _ in shapes]
        assert sum(bytes_of_codes) + 120 * len(shapes) + 138 > MOST_BYTES
        return
    assert len(frame.encode()) <= frame.limit <= MOST_BYTES
    assert Frame.decode(frame.encode()) == frame


def test_a_full_page_of_the_worst_values_reaches_its_limit() -> None:
    most, rows = 2**53 - 1, 13
    grid = Grid(10**12, 10**12, most, rows, 0.5)
    chess = np.indices((rows, 64)).sum(axis=0) % 2
    low = np.where(chess, 0.0, 2.0**23 + 5) + 2.0**51
    values = Interval(low, low + np.where(chess, 2.0**23 + 2, 0.0))
    samples = [
        PatchSamples.pack(values, 64.0, patch=1900 + k, grid=0, first_row=most, epoch=most)
        for k in range(12)
    ]
    instants = (2**63 - 2, 2**63 - 1)
    frame = Frame(Position(most, most), bytes(32), 255, most, instants, (grid,), tuple(samples))
    assert 60_000 < frame.limit <= MOST_BYTES
    assert frame.limit - 3 * len(samples) - 4 <= len(frame.encode()) <= frame.limit
    one_more = (*samples, replace(samples[-1], patch=1950))
    assert frame.limit + samples[-1].limit(grid) > MOST_BYTES
    with pytest.raises(MessageError):
        replace(frame, patches=one_more)


def test_few_bytes_become_no_more_samples_than_64_kib_hold() -> None:
    """Zeros take a byte for 64 samples; the receiver counts the worst case all the same."""
    for rows, is_refused in ((169, False), (170, True)):
        values = Interval(np.zeros((rows, 64)))
        large = PatchSamples.pack(values, 1.0, patch=0, grid=0, first_row=0)
        assert len(large.samples.codes) < 500
        grid = FAST._replace(rows=rows, first_row=0)
        fields = cbor2.loads(FRAME.encode()) | {8: [list(grid)], 9: [large.encode()]}
        if is_refused:
            with pytest.raises(MessageError):
                Frame.decode(dump(fields))
        else:
            assert Frame.decode(dump(fields)).limit <= MOST_BYTES


@pytest.mark.parametrize(("patches", "is_refused"), [(4, False), (5, True)])
def test_few_samples_lie_in_no_more_cells_than_allowed(
    patches: int,
    is_refused: bool,  # noqa: FBT001
) -> None:
    values = Interval(np.zeros((1000, 64)))
    grid = FAST._replace(rows=1000, first_row=0)
    strides = bytes([16]) * 64
    sparse = [
        PatchSamples.pack(values, 1.0, patch=k, grid=0, first_row=0, strides=strides).encode()
        for k in range(patches)
    ]
    data = dump(cbor2.loads(FRAME.encode()) | {8: [list(grid)], 9: sparse})
    if is_refused:
        for reader in (Frame, EncodedFrame):
            with pytest.raises(MessageError):
                reader.decode(data)
    else:
        summary = EncodedFrame.decode(data)
        assert int(summary.records["samples"].sum()) == patches * 64
        assert len(Frame.decode(data).patches) == patches


def test_layout_reads_its_frames_alone() -> None:
    FRAME.require_layout(LAYOUT, PATCHES)
    LAYOUT.require_patches(PATCHES)
    assert [LAYOUT.page_range(k) for k in range(2)] == [range(2), range(2, 3)]
    one_page = replace(LAYOUT, pages=(3,), controllers=())
    narrow = replace(
        PALM, taxels=("t00",), positions=(), neighbours=(), skew=(), beta=((0.0, 1.0),)
    )
    unshared = replace(PALM, alpha=(), beta=())
    refused: list[Callable[[], None]] = [
        lambda: FRAME.require_layout(one_page, PATCHES),
        lambda: replace(FRAME, page=1).require_layout(LAYOUT, PATCHES),
        lambda: replace(FRAME, page=2).require_layout(LAYOUT, PATCHES),
        lambda: FRAME.require_layout(LAYOUT, (narrow, AIR, WEARER)),
        lambda: FRAME.require_layout(LAYOUT, (unshared, AIR, WEARER)),
        lambda: LAYOUT.require_patches((AIR, PALM, WEARER)),
        lambda: one_page.require_patches(PATCHES),
    ]
    for patches in ((PALM, replace(PALM, patch_id="two")), (PALM, replace(AIR, patch_id="palm"))):
        hashes = tuple(patch.content_hash for patch in patches)
        refused.append(lambda h=hashes, p=patches: Layout(h, (2,)).require_patches(p))  # type: ignore[misc]
    hashes = (narrow.content_hash, AIR.content_hash)
    seamed = replace(LAYOUT, patches=hashes, pages=(2,), controllers=())
    refused.append(lambda: seamed.require_patches((narrow, AIR)))
    for refuse in refused:
        with pytest.raises(MessageError):
            refuse()


def test_hash_names_each_description_and_stays_the_same() -> None:
    assert PALM.content_hash == Patch.decode(PALM.encode()).content_hash
    others = {
        replace(PALM, threshold=2e3).content_hash,
        replace(PALM, patch_id="other").content_hash,
        PALM.content_hash,
    }
    assert len(others) == 3
    assert {len(each) for each in others} == {32}
    assert PALM.channels == ("t00.pressure", "t01.pressure", "t02.pressure")


def test_statements_that_are_too_long_are_refused_at_once() -> None:
    gap = Gap("x" * 100, (1, 2), 7, 1, (), ())
    with pytest.raises(MessageError):
        replace(STATEMENTS, gaps=(gap,) * 1000).encode()
    verdict = MonitorVerdict(
        "grip", (5, 6), Verdict.CERTAIN, final=True, because=Because(0), coverage=1.0
    )
    many = replace(STATEMENTS, verdicts=(verdict,) * 1000)
    assert Statements.decode(many.encode()) == many
