"""Recordings: what is good is kept, and each fault gives one line with file, place and reason."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from eskin_sensor_node.world.replay import read_recording
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

HEAD = "time,channel,value\n"
GOOD = [f"{k / 100},a,{k + 1}.5\n" for k in range(10)]


def written(folder: Path, text: str | bytes, name: str = "rec.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def parquet(folder: Path, **columns: Any) -> Path:
    path = folder / "rec.parquet"
    pyarrow.parquet.write_table(pa.table(columns), path)
    return path


def test_good_recording_is_read_whole(tmp_path: Path) -> None:
    found = read_recording(written(tmp_path, HEAD + "".join(GOOD)))
    series = found.channel("a")
    assert found.errors == ()
    assert series.times.tolist() == [k * 10_000_000 for k in range(10)]
    assert series.values.inf.tolist() == series.values.sup.tolist() == [k + 1.5 for k in range(10)]
    assert series.period == 10_000_000
    assert series.gaps == ()


FAULTS = {
    # what stands in line 7 (and after), and what is said of it
    "nan": ("0.05,a,nan\n", "line 7: value is NaN"),
    "infinite": ("0.05,a,inf\n", "line 7: value is inf"),
    "text": ("0.05,a,x\n", "line 7: value is 'x', which is no number"),
    "empty cell": ("0.05,a,\n", "line 7: value is '', which is no number"),
    "endless time": ("inf,a,1\n", "line 7: time is 'inf', which is too far away"),
    "far time": ("1e300,a,1\n", "line 7: time is '1e300', which is too far away"),
    "no channel": ("0.05,,1\n", "line 7: channel is ''"),
    "twice": ("0.04,a,1\n", "line 7: time 0.04 s of a stands twice"),
    "backwards": ("0.035,a,1\n", "line 7: time 0.035 s of a runs backwards"),
    "mid-line": ("0.05,a,1.23", "line 7: the file ends in the middle of this line"),
    "mid-line without value": ("0.05,a", "line 7: the file ends in the middle of this line"),
    "cells": ("0.05,a,1,2\n", "line 7: 4 cells instead of 3"),
    "empty line": ("\n", "line 7: 0 cells instead of 3"),
    "quote": ('0.05,"a,1\n', "line 7: it is no CSV"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_fault_gives_one_line_and_what_stood_before_is_kept(name: str, tmp_path: Path) -> None:
    line, said = FAULTS[name]
    path = written(tmp_path, HEAD + "".join(GOOD[:5]) + line)
    if not name.startswith("mid-line"):
        path.write_text(path.read_text() + "0.06,a,9\n")
    found = read_recording(path)
    assert len(found.errors) == 1
    assert str(found.errors[0]).startswith(f"{path}: {said}")
    assert "\n" not in str(found.errors[0])
    assert found.channel("a").values.inf.tolist() == [1.5, 2.5, 3.5, 4.5, 5.5]


def test_bytes_that_are_no_text_end_the_reading(tmp_path: Path) -> None:
    path = written(tmp_path, (HEAD + GOOD[0]).encode() + b"0.01,\xff,1\n")
    found = read_recording(path)
    assert str(found.errors[0]).startswith(f"{path}: line 3: it is no CSV")
    assert len(found.channel("a").times) == 1


def test_gap_is_read_and_stored_as_a_gap(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + "".join(GOOD[:4] + GOOD[7:]))
    found = read_recording(path)
    series = found.channel("a")
    assert [str(each) for each in found.errors] == [
        f"{path}: line 6: gap of 0.04 s in a before this; it is kept as a gap"
    ]
    assert series.gaps == ((30_000_000, 70_000_000),)
    _, missing = series.nearest(np.arange(11) * 10_000_000)
    assert np.flatnonzero(missing).tolist() == [4, 5, 6, 10]


def test_channels_are_apart_and_may_alternate(tmp_path: Path) -> None:
    rows = "".join(f"{k},{name},{k}{k}\n" for k in range(4) for name in ("b", "a"))
    found = read_recording(written(tmp_path, HEAD + rows))
    assert found.errors == ()
    assert found.channel("a").values.inf.tolist() == [0.0, 11.0, 22.0, 33.0]
    with pytest.raises(RecordingError, match=r"channel: 'c' is not in it; it has b, a"):
        found.channel("c")


def test_times_count_from_the_recording_s_first_sample(tmp_path: Path) -> None:
    rows = "1700000000000000000,a,1,2\n1700000000000000007,b,-inf,inf\n"
    found = read_recording(written(tmp_path, "time_ns,channel,lo,hi\n" + rows))
    assert found.channel("a").times.tolist() == [0]
    assert found.channel("b").times.tolist() == [7]
    assert found.channel("a").values.wid.tolist() == [1.0]
    assert found.channel("b").values.is_entire.all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "file: it is empty"),
        (HEAD, "file: it has a header, and no sample"),
        (HEAD[:-1], "line 1: the file ends in the middle"),
        (
            "t,channel,value\n",
            "header: it needs one of time, time_s and time_ns; it has t, channel",
        ),
        ("time,time_ns,channel,value\n", "header: it needs one of time"),
        ("time,value\n", "header: it needs channel"),
        ("time,channel,lo\n", "header: it needs either value, or lo and hi"),
        ("time,channel,lo,hi,value\n", "header: it needs either value, or lo and hi"),
        ("time,time,channel,value\n", "header: columns that stand twice: time"),
        (HEAD + "0,a,nan\n", "line 2: value is NaN"),
        ("time,channel,lo,hi\n0,a,2,1\n", "line 2: lo = 2.0 and hi = 1.0 are no interval"),
        ("time_ns,channel,value\n0.5,a,1\n", "line 2: time_ns is '0.5', which is no whole number"),
    ],
)
def test_nothing_to_keep_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert str(caught.value).startswith(f"{caught.value.file}: {caught.value.place}: ")


def test_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.csv: file: it cannot be read"):
        read_recording(tmp_path / "none.csv")


def test_parquet_equals_csv(tmp_path: Path) -> None:
    binary = read_recording(
        parquet(tmp_path, time=[0.0, 0.1, 0.2], channel=["a"] * 3, value=[1.0, 2.0, 3.0])
    )
    text = read_recording(written(tmp_path, HEAD + "0,a,1\n0.1,a,2\n0.2,a,3\n"))
    one, other = binary.channel("a"), text.channel("a")
    assert np.array_equal(one.times, other.times)
    assert np.all(one.values.equal(other.values))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"value": [1.0, 2.0, float("nan")]}, "row 3: value is NaN"),
        ({"value": [1.0, 2.0, None]}, "row 3: value is None, which is no number"),
        ({"channel": ["a", "a", None]}, "row 3: channel is None"),
        ({"time": [0.0, 0.1, 0.1]}, "row 3: time 0.1 s of a stands twice"),
    ],
)
def test_parquet_errors_name_their_row(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    columns = {"time": [0.0, 0.1, 0.2], "channel": ["a"] * 3, "value": [1.0, 2.0, 3.0]} | changes
    found = read_recording(parquet(tmp_path, **columns))
    assert [str(each) for each in found.errors] == [f"{tmp_path / 'rec.parquet'}: {said}"]
    assert len(found.channel("a").times) == 2


def test_parquet_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = parquet(tmp_path, time=[0.0], channel=["a"], value=[1.0])
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(RecordingError, match="file: it is no whole Parquet file"):
        read_recording(path)


def what_is_kept(path: Path) -> tuple[int, list[str]]:
    """How many samples of ``a``, and what is said of the rest."""
    try:
        found = read_recording(path)
    except RecordingError as error:
        return 0, [str(error)]
    kept = len(found.series["a"].times) if "a" in found.series else 0
    return kept, [str(each) for each in found.errors]


@settings(max_examples=100, deadline=None, database=None)
@given(st.binary(max_size=80), st.integers(0, 200))
def test_damaged_files_are_kept_up_to_their_damage_and_never_break_it(
    tmp_path_factory: pytest.TempPathFactory, junk: bytes, place: int
) -> None:
    whole = (HEAD + "".join(GOOD)).encode()
    path = tmp_path_factory.mktemp("damage") / "rec.csv"
    path.write_bytes(whole[:place] + junk + whole[place + len(junk) :])
    untouched = max(0, whole[:place].count(b"\n") - 1)
    kept, said = what_is_kept(path)
    assert kept >= untouched
    assert all(line.startswith(f"{path}: ") and "\n" not in line for line in said)


@settings(max_examples=60, deadline=None, database=None)
@given(st.integers(0, 130))
def test_file_cut_anywhere_keeps_its_whole_lines(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    whole = HEAD + "".join(GOOD)
    text = whole[:cut]
    path = written(tmp_path_factory.mktemp("cut"), text)
    lines = text.count("\n") - 1
    if lines < 1:
        with pytest.raises(RecordingError):
            read_recording(path)
    else:
        found = read_recording(path)
        assert len(found.channel("a").times) == lines
        assert len(found.errors) == (0 if text.endswith("\n") else 1)
