"""Frames, statements, patches and layouts of the firmware are those of `eskin.wire.frames`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.descriptions import describe_layout, describe_patch
from eskin_sensor_node.firmware.gap_reasons import FULL, TEXTS
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS, MessageWriter, Record
from eskin_sensor_node.firmware.sample_codec import Sampling, encode_samples, finest_exponent
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.interval import Verdict
from eskin.wire.frames import (
    Because,
    ClosedLine,
    Contact,
    Controller,
    EncodedFrame,
    Frame,
    Gap,
    Grid,
    Layout,
    Link,
    MonitorVerdict,
    Patch,
    PatchSamples,
    Peak,
    Seam,
    Statements,
)
from eskin.wire.messages import Position, Status
from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin.wire.timestamp import MOST_INSTANT
from tests.unit.eskin.wire.frames import examples
from tests.unit.eskin.wire.frames.matrices import matrices, samplings

if TYPE_CHECKING:
    from collections.abc import Callable

PLACE = Position(3, 17)
HASH = examples.LAYOUT.content_hash
DAY = 86_400 * 10**9
COUNTS = st.integers(0, MOST_COUNT)
INSTANTS = st.integers(-MOST_INSTANT, MOST_INSTANT)
TIMES = st.tuples(INSTANTS, INSTANTS).map(lambda pair: (min(pair), max(pair)))
REALS = st.floats(allow_nan=False)
BOUNDS = st.tuples(REALS, REALS).map(lambda pair: (min(pair), max(pair)))
SHARES = st.floats(0.0, 1.0)
FINITE = st.floats(-1e300, 1e300)
POSITIVE = st.floats(1e-300, 1e300)
NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,30}", fullmatch=True)
SPANS = st.tuples(COUNTS, COUNTS, COUNTS).map(lambda s: (s[0], min(s[1:]), max(s[1:])))


class Numbers:
    """The next number is always the same."""

    def __init__(self, number: int) -> None:
        self.number = number

    def next_sequence(self) -> int:
        return self.number


def writer(position: Position = PLACE, layout: bytes = HASH) -> MessageWriter:
    return MessageWriter(position.boot, Numbers(position.sequence), layout)


def written(frame: Frame) -> Record:
    """A frame, its samples encoded in plain Python."""
    patches = [
        [
            each.patch, each.grid, each.epoch, each.columns, *each.samples,
            *each.encode()[7:],
        ]
        for each in frame.patches
    ]  # fmt: skip
    return writer(frame.position, frame.layout).frame(
        frame.page, frame.ticks, frame.time, frame.grids, patches, samples=5, lasting=7
    )


@pytest.mark.parametrize("ticks", [0, 104 * DAY, 105 * DAY, 400 * DAY, 2**63 - 1])
def test_node_may_run_for_years(ticks: int) -> None:
    body = written(replace(examples.FRAME, ticks=ticks)).body
    assert Frame.decode(body).ticks == ticks
    assert EncodedFrame.decode(body).ticks == ticks
    record = writer().status((1, 2), "hand", "a hand", ticks, (0, 0, 1, 0), 0)
    assert Status.decode(record.body).uptime == ticks


@pytest.mark.parametrize("frame", [examples.FRAME, examples.SMALL[3]])
def test_frame_has_the_bytes_of_the_contract(frame: Frame) -> None:
    record = written(frame)
    assert record.body == frame.encode()
    assert (record.kind, record.sequence, record.samples) == (FRAME, 17, 5)
    assert (record.earliest, record.latest) == (frame.time[0], frame.time[1] + 7)
    assert record.gaps == 0


@given(st.data(), COUNTS, COUNTS, TIMES, SHARES, st.integers(1, 10**12))
@settings(max_examples=40, deadline=None)
def test_frame_of_any_samples_has_the_bytes_of_the_contract(
    data: st.DataObject, boot: int, ticks: int, time: tuple[int, int], coverage: float, period: int
) -> None:
    sampling = data.draw(samplings())
    if sampling.strides and not any(sampling.strides):
        sampling = sampling._replace(strides=b"")
    if not sum(sampling.counts):
        return
    values = data.draw(matrices(sampling))
    width = data.draw(st.sampled_from((1e-9, 1.0, 64.0)))
    grid = Grid(0, period, sampling.first_row, sampling.rows, coverage)
    wanted = PatchSamples.pack(
        values, width, patch=3, grid=0, first_row=sampling.first_row, strides=sampling.strides
    )
    plain = Sampling(sampling.rows, sampling.columns, sampling.first_row, sampling.strides)
    lows, highs = values.inf.ravel().tolist(), values.sup.ravel().tolist()
    found = encode_samples(lows, highs, plain, finest_exponent(width))
    patch = [3, 0, 0, sampling.columns, *found, *wanted.encode()[7:]]
    record = writer(Position(boot, 4)).frame(
        2, ticks, time, [grid], [patch], samples=sum(sampling.counts), lasting=0
    )
    frame = Frame(Position(boot, 4), HASH, 2, ticks, time, (grid,), (wanted,))
    assert record.body == frame.encode()


COUNTED: st.SearchStrategy[Any] = st.one_of(
    st.tuples(st.just(Verdict.CERTAIN), st.tuples(st.integers(1, 9), st.integers(9, 99))),
    st.tuples(st.just(Verdict.POSSIBLE), st.tuples(st.just(0), st.integers(1, 99))),
)
PEAKS = st.builds(
    lambda patch, column, time, counted, height, prominence, coverage: Peak(
        patch, column, time, counted[0], counted[1], height, prominence, coverage
    ),
    st.integers(0, 1999), st.integers(0, 63), TIMES, COUNTED, BOUNDS, BOUNDS, SHARES,
)  # fmt: skip
LINKS = st.builds(Link, COUNTS, st.sampled_from((Verdict.POSSIBLE, Verdict.CERTAIN)))
CONTACTS = st.builds(
    lambda label, time, counted, cells, force, centroid, coverage, links: Contact(
        label, time, counted[0], counted[1], cells, force, tuple(centroid), coverage, tuple(links)
    ),
    COUNTS, TIMES, COUNTED, st.just((1, 3)), BOUNDS, st.lists(BOUNDS, min_size=2, max_size=3),
    SHARES, st.lists(LINKS, max_size=3),
)  # fmt: skip
REASONED: st.SearchStrategy[Any] = st.one_of(
    st.tuples(
        st.just(Verdict.POSSIBLE), st.sampled_from((False,)), st.integers(1, 15).map(Because)
    ),
    st.tuples(
        st.sampled_from((Verdict.IMPOSSIBLE, Verdict.CERTAIN)), st.booleans(), st.just(Because(0))
    ),
)
VERDICTS = st.builds(
    lambda name, time, reasoned, coverage: MonitorVerdict(
        name, time, reasoned[0], reasoned[1], reasoned[2], coverage
    ),
    NAMES, TIMES, REASONED, SHARES,
)  # fmt: skip
GAPS = st.builds(
    Gap,
    st.text("abz 019.,é—", min_size=1, max_size=100),
    TIMES,
    COUNTS,
    COUNTS,
    st.lists(SPANS, max_size=4).map(tuple),
    st.sets(st.integers(0, 1999), max_size=9).map(lambda found: tuple(sorted(found))),
)


@given(
    st.lists(PEAKS, max_size=3), st.lists(CONTACTS, max_size=3), st.lists(VERDICTS, max_size=3),
    st.lists(GAPS, max_size=3), TIMES,
)  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_statements_have_the_bytes_of_the_contract(
    peaks: list[Peak],
    contacts: list[Contact],
    verdicts: list[MonitorVerdict],
    gaps: list[Gap],
    time: tuple[int, int],
) -> None:
    given_: dict[str, Any] = {
        "peaks": peaks,
        "contacts": contacts,
        "verdicts": verdicts,
        "gaps": gaps,
    }
    if not any(given_.values()):
        return
    record = writer().statements(time, **given_)
    parts: dict[str, Any] = {name: tuple(each) for name, each in given_.items()}
    wanted = Statements(PLACE, HASH, **parts)
    assert record.body == wanted.encode()
    assert Statements.decode(record.body) == wanted
    assert (record.kind, record.gaps) == (STATEMENTS, len(gaps))
    assert record.samples == sum(gap.samples for gap in gaps)
    assert record.named == sum(gap.messages for gap in gaps)


def test_gap_is_a_statement() -> None:
    record = writer().gap(FULL, (5, 9), 40, 2, [(1, 0, 1)], patches=(0, 2))
    gap = Gap(TEXTS[FULL], (5, 9), 2, 40, ((1, 0, 1),), (0, 2))
    assert Statements.decode(record.body) == Statements(PLACE, HASH, gaps=(gap,))
    assert (record.gaps, record.samples, record.named) == (1, 40, 2)


@pytest.mark.parametrize("patch", [*examples.PATCHES, *examples.SMALL[:2]])
def test_patch_has_the_bytes_of_the_contract(patch: Patch) -> None:
    assert describe_patch(patch) == patch.encode()


@pytest.mark.parametrize("layout", [examples.LAYOUT, examples.SMALL[2]])
def test_layout_has_the_bytes_of_the_contract(layout: Layout) -> None:
    assert describe_layout(layout) == layout.encode()


@st.composite
def patches(draw: Callable[[Any], Any]) -> Patch:
    taxels = tuple(draw(st.lists(NAMES, min_size=1, max_size=64, unique=True)))
    n = len(taxels)
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    axes = draw(st.sampled_from((0, 2, 3)))
    positions = random.integers(-(10**8), 10**8, (axes, n)).tolist()
    pairs = [(a, b) for a in range(n) for b in range(a + 1, n) if random.random() < 0.05]
    skew = tuple(random.integers(0, 10**6, n).tolist()) if draw(st.booleans()) else ()
    shared = draw(st.booleans())
    return Patch(
        patch_id=draw(NAMES),
        quantity="pressure",
        unit="Pa",
        taxels=taxels,
        least_width=draw(POSITIVE),
        positions=tuple(map(tuple, positions)),
        neighbours=tuple(pairs),
        skew=skew if any(skew) else (),
        alpha=((0.5, 2.0),) if shared else (),
        beta=((draw(st.floats(-9.0, 0.0)), 0.5),) if shared else (),
        slew=draw(st.none() | POSITIVE),
        threshold=draw(st.none() | POSITIVE),
        cell_area=draw(st.none() | POSITIVE),
    )


@given(patches())
@settings(max_examples=60, deadline=None)
def test_any_patch_has_the_bytes_of_the_contract(patch: Patch) -> None:
    data = describe_patch(patch)
    assert data == patch.encode()
    assert Patch.decode(data) == patch


COORDINATES = st.integers(-(10**8), 10**8)
LINES = st.lists(st.tuples(COORDINATES, COORDINATES), min_size=3, max_size=500).map(
    lambda points: ClosedLine(*zip(*points, strict=True))
)


@given(
    st.lists(st.integers(1, 9), min_size=1, max_size=9),
    st.booleans(),
    st.booleans(),
    st.lists(LINES, max_size=16),
)
@settings(max_examples=40, deadline=None)
def test_any_layout_has_the_bytes_of_the_contract(
    pages: list[int],
    seamed: bool,  # noqa: FBT001 - as drawn
    shared: bool,  # noqa: FBT001 - as drawn
    outline: list[ClosedLine],
) -> None:
    hashes = tuple(bytes([k]) * 32 for k in range(sum(pages)))
    seams = tuple(Seam(k, k + 1, ((0, 5), (3, 63))) for k in range(len(hashes) - 1))
    machines = tuple(Controller(f"hand-{k}", 1) for k in range(len(pages)))
    layout = Layout(
        hashes,
        tuple(pages),
        seams if seamed else (),
        machines if shared else (),
        tuple(outline),
    )
    assert describe_layout(layout) == layout.encode()
    assert Layout.decode(layout.encode()) == layout
    assert describe_layout(replace(layout, seams=())) == replace(layout, seams=()).encode()
