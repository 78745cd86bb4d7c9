"""Channels of a patch, and the same samples in frames of their own: all answers are the same."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.export import Export, ExportChannel
from eskin_cloud.query.series import read_series
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.store.read.lookup import UnknownChannelError, find_channel
from eskin_cloud.store.read.patch_runs import read_runs
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.interval import Interval
from eskin.monitor import Channel
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position
from tests.support.examples import examples
from tests.unit.cloud.brute_force import verdicts_of
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import START, stretch, tube_of
from tests.unit.cloud.skins import describe

if TYPE_CHECKING:
    from eskin_cloud.store import Store

FRAMED: Final = "framed"
APART: Final = "apart"
COLUMNS: Final = 3
_BOUNDS = st.sampled_from([-math.inf, -2.0, -0.1, 0.0, 0.1, 0.3, 1.0, 1.5, 3.0, math.inf])


@dataclass(frozen=True)
class Skin:
    """A patch, its layout, and frames."""

    patch: Patch
    layout: Layout
    frames: list[Frame]

    @property
    def apart(self) -> list[Frame]:
        """The same samples in frames of one channel each."""
        return [made for frame in self.frames for made in self._apart(frame)]

    def _apart(self, frame: Frame) -> list[Frame]:
        made = []
        (record,), (values,), (grid,) = frame.patches, frame.values, frame.grids
        for column, channel in enumerate(self.patch.channels):
            step = 1 << record.strides[column] if record.strides else 1
            rows = [r for r in range(grid.rows) if (grid.first_row + r) % step == 0]
            if not rows:
                continue
            behind = grid.delay + rows[0] * grid.period
            behind += self.patch.skew[column] if self.patch.skew else 0
            made.append(
                stretch(
                    frame.position.sequence * COLUMNS + column,
                    values.inf[rows, column],
                    values.sup[rows, column],
                    boot=frame.position.boot,
                    time=(frame.time[0] + behind, frame.time[1] + behind),
                    dt=grid.period * step,
                    channel=channel,
                    unit=self.patch.unit,
                    coverage=grid.coverage,
                )
            )
        return made


@st.composite
def skins(draw: st.DrawFn) -> Skin:
    """Frames of several boots, with gaps, overlaps, skews and strides."""
    skew = draw(st.sampled_from([(), (0, 2, 5)]))
    taxels = tuple(f"t{column}" for column in range(COLUMNS))
    patch = Patch("palm", "pressure", "Pa", taxels, 2.0**-3, skew=skew)
    layout = Layout((patch.content_hash,), (1,))
    frames = []
    for sequence in range(draw(st.integers(1, 8))):
        rows = draw(st.integers(1, 9))
        pairs = draw(
            st.lists(st.tuples(_BOUNDS, _BOUNDS), min_size=rows * COLUMNS, max_size=rows * COLUMNS)
        )
        lo = [-math.inf if min(pair) == math.inf else min(pair) for pair in pairs]
        hi = [math.inf if max(pair) == -math.inf else max(pair) for pair in pairs]
        first = START + draw(st.integers(0, 400))
        grid = Grid(
            delay=draw(st.integers(0, 3)),
            period=draw(st.sampled_from([10, 10, 7, 1])),
            first_row=draw(st.integers(0, 9)),
            rows=rows,
            coverage=draw(st.sampled_from([1.0, 0.99, 0.9])),
        )
        samples = PatchSamples.pack(
            Interval(np.reshape(lo, (rows, COLUMNS)), np.reshape(hi, (rows, COLUMNS))),
            patch.least_width,
            patch=0,
            grid=0,
            first_row=grid.first_row,
            strides=draw(st.sampled_from([b"", b"", b"\x00\x01\x02"])),
        )
        position = Position(draw(st.integers(1, 3)), sequence)
        time = first, first + draw(st.integers(0, 3))
        frames.append(Frame(position, layout.content_hash, 0, 0, time, (grid,), (samples,)))
    return Skin(patch, layout, draw(st.permutations(frames)))


windows = st.builds(
    lambda start, span: Window(START + start, START + start + span),
    st.integers(-30, 450),
    st.integers(0, 500),
)
_SLOWLY = settings(
    deadline=None,
    max_examples=examples(25),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def fill(store: Store, skin: Skin) -> None:
    """Store both, one node each."""
    emptied(store)
    describe(store, skin.layout, skin.patch, node=FRAMED)
    outcome = put(store, *skin.frames, node=FRAMED)
    assert {each.result for each in outcome.results} == {"stored"}
    put(store, *skin.apart, node=APART)


def pairs_of(connection: Any, skin: Skin) -> list[tuple[Any, Any]]:
    """The channels of both nodes that have samples."""
    found = []
    for channel in skin.patch.channels:
        try:
            apart = find_channel(connection, APART, channel)
        except UnknownChannelError:
            continue
        found.append((find_channel(connection, FRAMED, channel), apart))
    return found


@_SLOWLY
@given(skin=skins(), window=windows, points=st.sampled_from([1, 3, 10, 1000]))
def test_series_are_those_of_channels_apart(
    store: Store, skin: Skin, window: Window, points: int
) -> None:
    fill(store, skin)
    with store.read() as connection:
        for framed, apart in pairs_of(connection, skin):
            one = read_series(connection, framed, window, points=points)
            other = read_series(connection, apart, window, points=points)
            assert (one.resolution, one.t0, one.unit) == (other.resolution, other.t0, other.unit)
            assert one.t.tolist() == other.t.tolist()
            assert one.lo.tolist() == other.lo.tolist()
            assert one.hi.tolist() == other.hi.tolist()
            if len(one.t) and np.isfinite(one.lo).any():
                assert (one.coverage, one.time_error) == (other.coverage, other.time_error)
            if one.mean is not None and other.mean is not None:
                assert np.array_equal(one.mean, other.mean)


@_SLOWLY
@given(skin=skins(), window=windows, low=st.sampled_from([0.0, 0.2, 1.0]))
def test_verdicts_are_those_of_channels_apart(
    store: Store, skin: Skin, window: Window, low: float
) -> None:
    fill(store, skin)
    above = Channel("x") > low
    with store.read() as connection:
        for framed, apart in pairs_of(connection, skin):
            one, other = (verdicts_of(connection, each, window, above) for each in (framed, apart))
            assert one == other


@_SLOWLY
@given(skin=skins(), window=windows)
def test_comparisons_are_those_of_channels_apart(store: Store, skin: Skin, window: Window) -> None:
    fill(store, skin)
    above = Channel("x") > Channel("y")
    with store.read() as connection:
        found = pairs_of(connection, skin)
        one, other = (
            [*StoredVerdicts(above, dict(zip("xy", sources, strict=True))).pieces(window)]
            for side in (0, 1)
            if (sources := [ChannelSource(connection, found[k][side]) for k in (0, -1)])
        )
        assert one == other


@_SLOWLY
@given(skin=skins(), window=windows, limit=st.integers(1, 40))
def test_exports_are_those_of_channels_apart_however_they_are_resumed(
    store: Store, skin: Skin, window: Window, limit: int
) -> None:
    fill(store, skin)
    with store.read() as connection:
        sides = list(zip(*pairs_of(connection, skin), strict=True))
    framed, apart = (
        Export([ExportChannel(row, store.read) for row in side], window, None) for side in sides
    )
    assert framed.samples() == apart.samples()
    expected = exported(apart)
    assert exported(framed) == expected
    resumed, at = [], framed
    while True:
        until = at.find_end(limit)
        resumed += exported(at, until)
        if until is None:
            break
        at = Export(framed.sources, window, until)
    assert resumed == expected


def exported(export: Export, until: Any = None) -> list[tuple[Any, ...]]:
    """What an export holds, in order; a run without samples in the window is as good as none."""
    return [
        (part.channel["channel"], run.t, run.dt, run.coverage, run.lo.tolist(), run.hi.tolist())
        for part in export.read(until)
        for run in part.runs
        if any(export.window.start <= run.t + k * run.dt < export.window.end
               for k in range(run.lo.size))
    ]  # fmt: skip


@_SLOWLY
@given(skin=skins(), window=windows)
def test_runs_are_the_frames_samples(store: Store, skin: Skin, window: Window) -> None:
    fill(store, skin)
    with store.read() as connection:
        runs = read_runs(connection, FRAMED, "palm", window)
    expected = {frame.position: frame for frame in skin.frames}
    assert [(run.t, run.boot, run.sequence) for run in runs] == (
        sorted((run.t, run.boot, run.sequence) for run in runs)
    )
    for run in runs:
        frame = expected[Position(run.boot, run.sequence)]
        assert run.patch == skin.patch.content_hash
        assert run.strides == frame.patches[0].strides
        assert np.array_equal(run.lo, frame.values[0].inf)
        assert np.array_equal(run.hi, frame.values[0].sup)
    touching = {
        made.position.sequence // COLUMNS
        for made in skin.apart
        for t in tube_of(made).instants
        if window.start <= t < window.end
    }
    assert touching <= {run.sequence for run in runs}


def test_unknown_channel_of_a_node_with_frames_is_refused(store: Store) -> None:
    skin = Skin(
        patch := Patch("palm", "pressure", "Pa", ("t0",), 0.5),
        Layout((patch.content_hash,), (1,)),
        [],
    )
    describe(store, skin.layout, skin.patch, node=FRAMED)
    with store.read() as connection, pytest.raises(UnknownChannelError):
        find_channel(connection, FRAMED, "t1.pressure")
