"""Contacts over time: labels, pieces of a record, bounded memory, and times that cannot be."""

from __future__ import annotations

from itertools import pairwise
from math import nan
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.contacts import ContactStream, ContactTracks, Skin, track_contacts
from eskin.errors import ContactError, IntervalError
from eskin.interval import Verdict

THRESHOLD: Final = 1000.0
_BOUNDS: Final = {".": (0.0, 100.0), "?": (500.0, 1500.0), "#": (1500.0, 1600.0), "x": (nan, nan)}


def bounds(rows: list[str]) -> tuple[Any, Any, Any]:
    """Instants of a row of taxels: ``#`` certain, ``?`` possible, ``x`` unknown, ``.`` not."""
    lo, hi = np.array([[_BOUNDS[each] for each in row] for row in rows]).transpose(2, 0, 1)
    earliest = 100 * np.arange(len(rows))
    return lo, hi, np.stack([earliest, earliest + 30], axis=1)


def skin_of(rows: list[str]) -> Skin:
    return Skin.grid(1, len(rows[0]), pitch=0.004, area=1e-5)


def track(*rows: str) -> ContactTracks:
    return track_contacts(*bounds(list(rows)), skin_of(list(rows)), THRESHOLD)


def labels(tracks: ContactTracks) -> list[list[int]]:
    """The labels of each instant's cores."""
    cores = tracks.cores
    return [
        cores["track"][cores["sample"] == k].tolist() for k in tracks.instants["sample"].tolist()
    ]


def test_contact_that_comes_and_goes_has_a_begin_and_an_end() -> None:
    tracks = track(".....", "..?..", ".?#?.", "..#..", "..?..", ".....", ".....")
    (one,) = tracks
    assert (one.first, one.last, one.verdict) == (2, 3, Verdict.CERTAIN)
    assert one.begin == (0, 230)  # impossible at sample 0, certain at sample 2
    assert one.end == (300, 530)  # certain at sample 3, impossible at sample 5


def test_contact_at_the_edges_of_a_record_has_no_bound_there() -> None:
    (one,) = track("#", "#")
    assert (one.begin, one.end) == ((None, 30), (100, None))


def test_flickering_contact_keeps_its_label_and_is_possibly_another() -> None:
    tracks = track("..#..", "..?..", "..#..", "..#..")
    assert labels(tracks) == [[0], [], [0], [0]]
    assert [each.verdict for each in tracks] == [Verdict.POSSIBLE]


def test_sliding_contact_keeps_its_label() -> None:
    tracks = track(".##?....", "..?##?..", "....?##.")
    assert labels(tracks) == [[0], [0], [0]]
    assert tracks[0].verdict is Verdict.POSSIBLE  # no taxel is certain at the last two instants


def test_label_goes_to_the_core_that_shares_most_taxels() -> None:
    tracks = track("#######", "##.####", "##.####")
    assert labels(tracks) == [[0], [1, 0], [1, 0]]
    assert [each.begin for each in tracks] == [(None, 30), (None, 30)]


def test_merged_contact_gets_its_label_back() -> None:
    tracks = track("##.####", "#######", "##.####", ".......")
    assert labels(tracks) == [[0, 1], [1], [0, 1], []]
    assert [each.verdict for each in tracks] == [Verdict.CERTAIN] * 2
    assert [each.end for each in tracks] == [(200, 330)] * 2


def test_contact_that_merged_ends_with_the_one_that_it_merged_into() -> None:
    tracks = track("##.####", "#######", "...####", ".......")
    assert labels(tracks) == [[0, 1], [1], [1], []]
    assert [(each.last, each.end) for each in tracks] == [(0, (200, 330)), (2, (200, 330))]


def test_nearest_of_several_labels_is_taken() -> None:
    tracks = track("#?????#", "???????", "?????#?", "?#?????")
    assert labels(tracks) == [[0, 1], [], [1], [0]]


def test_contacts_of_different_regions_have_different_labels() -> None:
    tracks = track("#....", "....#", "#....")
    assert labels(tracks) == [[0], [1], [2]]
    assert [each.begin for each in tracks] == [(None, 30), (0, 130), (100, 230)]


def test_skin_of_which_nothing_is_known_leaves_all_open() -> None:
    tracks = track("#....", "xxxxx", "....#")
    assert labels(tracks) == [[0], [], [0]]
    assert tracks[0].verdict is Verdict.POSSIBLE
    assert tracks.instants["possible"].tolist() == [0, 1, 0]


ROWS = st.integers(1, 6).flatmap(
    lambda n: st.lists(st.text("..??##x", min_size=n, max_size=n), min_size=1, max_size=12)
)


@given(rows=ROWS, cut=st.integers(0, 12), again=st.integers(0, 12))
def test_pieces_give_what_the_whole_gives(rows: list[str], cut: int, again: int) -> None:
    lo, hi, times = bounds(rows)
    stream = ContactStream(skin_of(rows), THRESHOLD)
    ends = sorted({0, min(cut, len(rows)), min(again, len(rows)), len(rows)})
    pieces = [
        stream.feed(lo[first:last], hi[first:last], times[first:last])
        for first, last in pairwise(ends)
    ]
    pieces.append(stream.finish())
    whole = track(*rows)
    table = np.concatenate([piece.table for piece in pieces])
    assert np.array_equal(table[np.argsort(table["id"])], whole.table)
    assert np.array_equal(np.concatenate([piece.cores for piece in pieces]), whole.cores)
    assert np.array_equal(np.concatenate([piece.instants for piece in pieces]), whole.instants)


@given(rows=ROWS)
def test_labels_are_given_once_at_each_instant_and_in_order(rows: list[str]) -> None:
    tracks = track(*rows)
    for chosen in labels(tracks):
        assert len(chosen) == len(set(chosen))
    assert [each.id for each in tracks] == list(range(len(tracks)))
    firsts = [each.first for each in tracks]
    assert firsts == sorted(firsts)
    for each in tracks:
        assert each.begin[0] is None or each.begin[0] <= each.begin[1]
        assert each.end[1] is None or each.end[0] <= each.end[1]
        assert each.begin[1] <= 100 * each.first + 30
        assert each.end[0] >= 100 * each.last


def test_stream_gives_up_what_waits_longest_once_more_than_its_taxels_wait() -> None:
    # A taxel is always possible; beside it a contact comes, may merge with it, and disappears.
    rows = ["?.#", "???", "?.."] * 5
    lo, hi, times = bounds(rows)
    stream = ContactStream(skin_of(rows), THRESHOLD)
    found = [stream.feed(lo[k : k + 1], hi[k : k + 1], times[k : k + 1]) for k in range(15)]
    given_up = [(k, each.id, each.end) for k, tracks in enumerate(found) for each in tracks]
    assert given_up == [(10, 0, (0, None)), (13, 1, (300, None))]
    assert [each.id for each in stream.finish()] == [2, 3, 4]


def test_what_follows_a_finished_record_is_linked_to_nothing() -> None:
    lo, hi, times = bounds(["#", "#"])
    stream = ContactStream(skin_of(["#"]), THRESHOLD)
    stream.feed(lo[:1], hi[:1], times[:1])
    (one,) = stream.finish()
    assert stream.feed(lo[1:], hi[1:], times[1:]).cores[["sample", "track"]].tolist() == [(1, 1)]
    (two,) = stream.finish()
    assert (one.end, two.begin) == ((0, None), (None, 130))


def test_stream_of_no_samples_finds_nothing() -> None:
    stream = ContactStream(skin_of(["###"]), THRESHOLD)
    found = stream.feed(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2), np.int64))
    assert (len(found), len(found.cores), len(found.instants), len(stream.finish())) == (0,) * 4


@pytest.mark.parametrize(
    "times",
    [
        [0, 100],
        [(0, 30, 60), (100, 130, 160)],
        [(30, 0), (100, 130)],
        [(100, 130), (0, 30)],
        [(0, 130), (100, 120)],
        [(0.0, 30.0), (100.0, 130.0)],
        [(0, 2**63), (100, 2**63)],
    ],
)
def test_times_that_enclose_no_instants_in_order_are_rejected(times: Any) -> None:
    lo, hi, _ = bounds(["#", "#"])
    with pytest.raises(ContactError):
        track_contacts(lo, hi, times, skin_of(["#"]), THRESHOLD)


def test_samples_that_cannot_be_used_leave_the_stream_as_it_was() -> None:
    lo, hi, times = bounds(["#", "#", "#"])
    stream = ContactStream(skin_of(["#"]), THRESHOLD)
    stream.feed(lo[:1], hi[:1], times[:1])
    with pytest.raises(ContactError):
        stream.feed(lo[1:], hi[1:], times[1:] - 200)
    with pytest.raises(IntervalError):
        stream.feed([[1500.0], [1.0]], [[1600.0], [0.0]], times[1:])
    with pytest.raises(IntervalError):
        stream.feed(lo[1:], hi[1:], times[1:2])
    assert stream.feed(lo[1:], hi[1:], times[1:]).cores["track"].tolist() == [0, 0]


def test_threshold_of_a_stream_is_checked() -> None:
    with pytest.raises(ContactError):
        ContactStream(skin_of(["#"]), 0.0)
