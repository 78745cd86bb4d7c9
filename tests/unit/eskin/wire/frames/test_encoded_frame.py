"""The compiled look at a frame finds what `Frame.decode` finds."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cbor2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.wire.frames import EncodedFrame, Frame, Grid, PatchSamples
from eskin.wire.frames import encoded_frame as module
from eskin.wire.messages import Position
from tests.unit.eskin.wire.frames.examples import FRAME, SMALL, head_fields
from tests.unit.eskin.wire.frames.matrices import matrices, samplings

if TYPE_CHECKING:
    from eskin.wire.frames import Sampling

FRAMES = [each for each in (FRAME, *SMALL) if isinstance(each, Frame)]
COUNTS = st.integers(0, 2**53 - 1) | st.sampled_from((0, 23, 24, 255, 256, 65_535, 65_536, 2**32))
INSTANTS = st.tuples(st.integers(-(2**62), 2**62), st.integers(0, 2**33))


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    """Frames of some patches on some grids."""
    sampled: list[Sampling] = draw(st.lists(samplings(), min_size=1, max_size=4))
    grids: list[Grid] = []
    patches = []
    for number, sampling in enumerate(sampled):
        if not sum(sampling.counts):
            continue
        strides = sampling.strides if any(sampling.strides) else b""
        period = draw(st.integers(1, 10**12))
        grid = Grid(draw(st.integers(0, 10**12)), period, sampling.first_row, sampling.rows, 0.5)
        if grid not in grids:
            grids.append(grid)
        epoch = draw(st.sampled_from((0, 1, 2**40)))
        columns = st.sets(st.integers(0, sampling.columns - 1))
        patches.append(
            PatchSamples.pack(
                draw(matrices(sampling)),
                draw(st.sampled_from((1e-9, 1.0, 64.0))),
                patch=number * draw(st.integers(1, 400)),
                grid=grids.index(grid),
                first_row=sampling.first_row,
                epoch=epoch,
                strides=strides,
                unshared=sorted(draw(columns)) if epoch else (),
            )
        )
    patches.sort(key=lambda each: each.patch)
    used = list(dict.fromkeys(each.grid for each in patches))
    kept = {each.patch: replace(each, grid=used.index(each.grid)) for each in patches}
    early, width = draw(INSTANTS)
    return Frame(
        Position(draw(COUNTS), draw(COUNTS)),
        draw(st.binary(min_size=32, max_size=32)),
        draw(st.integers(0, 255)),
        draw(COUNTS),
        (early, early + width),
        tuple(grids[each] for each in used),
        tuple(kept.values()),
    )


def compare(found: EncodedFrame, data: bytes) -> None:
    expected = EncodedFrame.of(Frame.decode(data), data)
    assert head_fields(found) == head_fields(expected)
    for name in module.PATCH_RECORD.names or ():
        assert found.records[name].tolist() == expected.records[name].tolist(), name
    for record in found.records:
        begin = int(record["offset"])
        item = cbor2.loads(data[begin : begin + int(record["length"])])
        assert PatchSamples.read(item).patch == record["patch"]


def only_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where the compiled look does not find a frame that is one."""

    def refuse(_: bytes) -> Frame:
        raise AssertionError("the compiled look found no frame")

    monkeypatch.setattr(Frame, "decode", refuse)


@pytest.mark.parametrize("frame", FRAMES)
def test_examples_are_found(frame: Frame, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        only_fast(patched)
        found = EncodedFrame.decode(frame.encode())
    compare(found, frame.encode())


@settings(deadline=None)
@given(st.data())
def test_any_frame_is_found(data: st.DataObject) -> None:
    try:
        frame = data.draw(frames())
    except MessageError:  # no sample at all, or too long
        return
    with pytest.MonkeyPatch.context() as patched:
        only_fast(patched)
        found = EncodedFrame.decode(frame.encode())
    compare(found, frame.encode())


def read(data: bytes) -> Frame | None:
    try:
        return Frame.decode(data)
    except MessageError:
        return None


@pytest.mark.parametrize("frame", FRAMES)
def test_changed_bytes_are_refused_as_by_the_slow_way(frame: Frame) -> None:
    """Every byte, by every bit and to some values; and cut or longer ones."""
    data = frame.encode()
    changed = [
        data[:place] + bytes([value]) + data[place + 1 :]
        for place in range(len(data))
        for value in {*(data[place] ^ 1 << bit for bit in range(8)), 0, 0x18, 0x1B, 0xFF}
    ]
    changed += [data[:end] for end in range(len(data))] + [data + b"\0", data + data]
    for each in changed:
        expected = read(each)
        if expected is None:
            with pytest.raises(MessageError):
                EncodedFrame.decode(each)
        else:
            compare(EncodedFrame.decode(each), each)


@settings(deadline=None)
@given(st.data())
def test_frames_of_other_parts_are_refused_as_by_the_slow_way(data: st.DataObject) -> None:
    """Fields that are well-formed, and that do not fit each other."""
    fields = cbor2.loads(FRAME.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        patch = data.draw(st.sampled_from(fields[9]))
        at = data.draw(st.sampled_from((0, 1, 2, 3, 4, 5, "grids", "options", "page", "time")))
        number = data.draw(st.sampled_from((0, 1, 2, 3, 15, 16, 64, 65, 1000, 1001, 2**53, -1)))
        if at == "grids":
            fields[8] = data.draw(st.permutations([*fields[8], list(FRAME.grids[0])]))[: number % 4]
        elif at == "options":
            bits = st.sampled_from((b"\0", b"\4", b"\xff", b"\0\0\0", b"\0\1\0", b"\x11\0\0"))
            patch[7:] = [data.draw(st.dictionaries(st.sampled_from((1, 2, 3)), bits, max_size=2))]
        elif at == "page":
            fields[5] = number
        elif at == "time":
            fields[7] = [number, data.draw(st.sampled_from((0, 5, 2**63 - 1, -(2**63))))]
        else:
            patch[at] = number
    encoded = cbor2.dumps(fields)
    if (expected := read(encoded)) is None:
        with pytest.raises(MessageError):
            EncodedFrame.decode(encoded)
    else:
        compare(EncodedFrame.decode(encoded), encoded)
        assert np.isfinite(len(expected.patches))


def test_empty_options_are_refused() -> None:
    fields = cbor2.loads(FRAME.encode())
    for k in range(len(fields[9])):
        patches = [[*row[:7], {}] if at == k else row for at, row in enumerate(fields[9])]
        encoded = cbor2.dumps(fields | {9: patches})
        for decode in (Frame.decode, EncodedFrame.decode):
            with pytest.raises(MessageError):
                decode(encoded)
