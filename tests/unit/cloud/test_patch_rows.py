"""Rows of a patch hold what its frames held, value for value."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.store.column_runs import ColumnRun, ColumnRuns
from eskin_cloud.store.patch_rows import decode_column, decode_matrix, decode_runs, encode_runs
from eskin_cloud.store.patch_run import PatchRun
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.errors import MessageError
from eskin.wire.frames import SampleCodes, Sampling, decode_samples, encode_samples
from tests.unit.eskin.wire.frames.matrices import SIZES, matrices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from eskin.interval import Interval

HASH = bytes(range(32))
INT64 = st.integers(-(2**63), 2**63 - 1)
COUNT = st.integers(0, 2**53 - 1)
INSTANT = st.integers(-(2**62), 2**62)


def same(runs: list[PatchRun], others: list[PatchRun]) -> bool:
    """Whether runs are equal, their bounds bit for bit."""
    return len(runs) == len(others) and all(
        one[:-2] == other[:-2]
        and all(
            a.shape == b.shape and a.tobytes() == b.tobytes()
            for a, b in zip(one[-2:], other[-2:], strict=True)
        )
        for one, other in zip(runs, others, strict=True)
    )


@st.composite
def frames_of_a_patch(draw: st.DrawFn) -> list[PatchRun]:
    """Runs as frames give them: any exponents and offsets, strides, gaps, several boots."""
    columns = draw(st.integers(1, 5) | st.sampled_from((64,)))
    strides = bytes(draw(st.lists(st.integers(0, 3), min_size=columns, max_size=columns)))
    unshared = tuple(sorted(draw(st.sets(st.integers(0, columns - 1)))))
    runs = []
    for _ in range(draw(st.integers(1, 6))):
        first_row = draw(st.sampled_from((0, 1, 6, 1001, 2**53 - 1)) | COUNT)
        chosen = draw(st.sampled_from((b"", strides)))
        sampling = Sampling(draw(st.integers(1, 7)), columns, first_row, chosen)
        values = draw(frame_values(sampling))
        runs.append(
            PatchRun(
                HASH, draw(COUNT), draw(COUNT), draw(COUNT), draw(INSTANT), draw(COUNT),
                draw(st.integers(1, 10**12)), first_row, chosen, draw(COUNT),
                draw(st.sampled_from(((), unshared))), draw(st.floats(0, 1)),
                values.inf, values.sup,
            )
        )  # fmt: skip
    return runs


@st.composite
def frame_values(draw: st.DrawFn, sampling: Sampling) -> Interval:
    """What a frame's codes are decoded to; a node may write any exponent and offset."""
    encoded = encode_samples(draw(matrices(sampling)), sampling, draw(st.sampled_from(SIZES)))
    exponent = draw(st.sampled_from((-1000, -5, 0, 930)) | st.just(encoded.exponent))
    far = 2**53 - 2**26
    offset = draw(st.sampled_from((-far, 0, far)) | st.just(encoded.offset))
    return decode_samples(SampleCodes(exponent, offset, encoded.codes), sampling)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(runs=frames_of_a_patch())
def test_runs_come_back_as_they_were(runs: list[PatchRun]) -> None:
    assert same(decode_runs(encode_runs(runs)), runs)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(runs=frames_of_a_patch())
def test_arrays_are_those_of_the_runs(runs: list[PatchRun]) -> None:
    found = decode_matrix(encode_runs(runs))
    heads = zip(found.t, found.error, found.dt, found.first_row, found.rows, strict=True)
    assert [tuple(each) for each in heads] == [
        (run.t, run.error, run.dt, run.first_row, len(run.lo)) for run in runs
    ]
    assert [found.strides[option] for option in found.option] == [run.strides for run in runs]
    assert np.array_equal(found.lo, np.concatenate([run.lo for run in runs]))
    assert np.array_equal(found.hi, np.concatenate([run.hi for run in runs]))


def of_column(run: PatchRun, column: int) -> ColumnRun | None:
    """The samples of a column, picked one by one."""
    step = 2 ** run.strides[column] if run.strides else 1
    rows = [k for k in range(len(run.lo)) if (run.first_row + k) % step == 0]
    if not rows:
        return None
    return ColumnRun(
        run.t + rows[0] * run.dt, run.boot, run.sequence, run.dt * step, run.error, run.coverage,
        run.lo[rows, column], run.hi[rows, column],
    )  # fmt: skip


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), runs=frames_of_a_patch())
def test_a_column_is_that_of_all(data: st.DataObject, runs: list[PatchRun]) -> None:
    column = data.draw(st.integers(0, runs[0].lo.shape[1] - 1))
    expected = [each for run in runs if (each := of_column(run, column)) is not None]
    found = list(decode_column(encode_runs(runs), column))
    assert [each[:6] for each in found] == [each[:6] for each in expected]
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.lo.tolist() == theirs.lo.tolist()
        assert ours.hi.tolist() == theirs.hi.tolist()


@given(runs=frames_of_a_patch())
def test_a_column_that_is_not_there_is_refused(runs: list[PatchRun]) -> None:
    with pytest.raises(MessageError):
        decode_column(encode_runs(runs), runs[0].lo.shape[1])


@pytest.mark.nightly
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), runs=frames_of_a_patch())
def test_other_bytes_are_refused_or_read_as_intervals(
    data: st.DataObject, runs: list[PatchRun]
) -> None:
    """Digests show a reader that a row is damaged; without them it must at least not break."""
    good = bytearray(encode_runs(runs))
    for _ in range(data.draw(st.integers(1, 3))):
        good[data.draw(st.integers(0, len(good) - 1))] ^= data.draw(st.integers(1, 255))
    damaged = bytes(good[: data.draw(st.integers(0, len(good)) | st.just(len(good)))])
    readers: tuple[Callable[[bytes], Iterable[PatchRun | ColumnRun]], ...] = (
        decode_runs,
        lambda row: decode_column(row, 0),
    )
    for read in readers:
        try:
            found = read(damaged)
        except MessageError:
            continue
        assert all(np.all(run.lo <= run.hi) for run in found)


@given(data=st.binary(max_size=100))
def test_any_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError):
        decode_runs(data)


def steady(count: int, rows: int, columns: int, exponent: int = -5) -> list[PatchRun]:
    random = np.random.default_rng(columns)
    base = random.integers(-9, 9, (count * rows, columns)).cumsum(axis=0) * 2.0**exponent
    wide = base + random.integers(0, 9, base.shape) * 2.0**exponent
    return [
        PatchRun(
            HASH, 1, 3 * k, k * 10**8, 17 * 10**17 + k * 10**8 + k % 3, 2000 + k, 20_000_000,
            k * rows, b"", 1, (), 1.0, base[k * rows : (k + 1) * rows],
            wide[k * rows : (k + 1) * rows],
        )
        for k in range(count)
    ]  # fmt: skip


def test_frames_of_other_exponents_stand_in_one_row() -> None:
    """As where autoranging switches: fine quanta near zero, then coarse ones far from it."""
    fine, coarse = steady(4, 5, 3, -40), steady(4, 5, 3, 10)
    assert same(decode_runs(encode_runs(fine + coarse + fine)), fine + coarse + fine)


def test_heads_take_few_bytes() -> None:
    """One instant in a frame costs at most a few bytes beyond its samples."""
    apart, joined = steady(500, 1, 1), steady(1, 500, 1)
    assert len(encode_runs(apart)) - len(encode_runs(joined)) < 500 * 8


def test_runs_of_two_descriptions_or_without_samples_of_a_frame_are_refused() -> None:
    one = steady(1, 2, 2)[0]
    with pytest.raises(MessageError):
        encode_runs([one, one._replace(patch=HASH[::-1])])
    with pytest.raises(MessageError):
        encode_runs([one, *steady(1, 2, 3)])
    with pytest.raises(MessageError):
        encode_runs([one._replace(lo=one.lo + np.pi, hi=one.hi + 2.0**60)])
    with pytest.raises(MessageError):
        encode_runs([one._replace(lo=one.hi + 1.0)])
    with pytest.raises(MessageError):
        decode_column(encode_runs([one]), 2)


def test_order_and_gaps_stay() -> None:
    runs = steady(9, 3, 2)
    moved = [*runs[5:], *runs[:3]]
    found = decode_runs(encode_runs(moved))
    assert [run.sequence for run in found] == [run.sequence for run in moved]
    assert [b.t - a.t for a, b in pairwise(found)] == [b.t - a.t for a, b in pairwise(moved)]


RUN = st.builds(
    lambda t, n, dt, sequence: ColumnRun(
        t, 1, sequence, dt, 3, 0.5, np.arange(float(n)) + sequence, np.arange(float(n)) + 9
    ),
    st.integers(-50, 50),
    st.integers(1, 5),
    st.integers(1, 20),
    st.integers(0, 99),
)


@given(
    runs=st.lists(RUN, max_size=6, unique_by=lambda run: run.sequence),
    start=st.integers(-60, 60),
    span=st.integers(0, 60),
)
def test_runs_in_arrays_are_sorted_and_clipped_as_one_by_one(
    runs: list[ColumnRun], start: int, span: int
) -> None:
    found = ColumnRuns.of(runs).sorted()
    assert [each[:6] for each in found] == sorted(each[:6] for each in runs)
    assert sorted(found.lo.tolist()) == sorted(x for run in runs for x in run.lo.tolist())
    first, last = found.clipped(start, start + span)
    for run, begin, end in zip(found, first.tolist(), last.tolist(), strict=True):
        inside = [k for k in range(run.lo.size) if start <= run.t + k * run.dt < start + span]
        assert list(range(begin, end + 1)) == inside
        assert run.lo[0] == run.sequence
