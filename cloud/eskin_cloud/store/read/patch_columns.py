"""Channels: each is a column of a patch, whose samples are read from runs of the patch."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.store.column_runs import ColumnRun, ColumnRuns
from eskin_cloud.store.damage import DamagedRowError, are_countable
from eskin_cloud.store.descriptions import find_patch
from eskin_cloud.store.patch_rows import decode_column, decode_heads
from eskin_cloud.store.read.patch_runs import (
    decode_rows,
    find_patch_pages,
    first_start,
    last_start,
    read_fresh,
    read_patch,
    split_by_rows,
)
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.schema.frame_tables import frames, patch_rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.frames import Patch
    from eskin_cloud.store.patch_run import PatchRun
    from eskin_cloud.store.read.lookup import Channel

_WIDER: Final = 64


def describe_columns(connection: Connection, node: str, patch: Patch) -> list[dict[str, Any]]:
    """All channels of a patch.

    ``patch`` and ``column`` state where a channel stands. Times and ``longest`` are those of all
    that is stored together with it: of its page, and of its patch once its frames are compacted.
    ``dt`` is the period of the last samples; 0 if no frame can be read, such as of encrypted ones.

    Raises:
        DamagedRowError: Totals of a page or of the patch are damaged, or all of its samples may be.
    """
    places = find_patch_pages(connection, node, patch.patch_id, strict=True)
    compacted = read_patch(connection, node, patch.patch_id)
    rows: list[RowMapping] = [place.totals for place in places]
    rows += [] if compacted is None else [compacted]
    found: dict[str, Any] = {
        "node": node,
        "unit": patch.unit,
        "patch": patch.patch_id,
        "grain": None if compacted is None else compacted["grain"],
        "built": None if compacted is None else compacted["built"],
        "longest": max((row["longest"] for row in rows), default=0),
        "t_first": min((r["t_first"] for r in rows if r["t_first"] is not None), default=None),
        "t_last": max((r["t_last"] for r in rows if r["t_last"] is not None), default=None),
    }
    last = _last_run(connection, found)
    # Period and coverage are those of the last samples: unknown where all may be damaged.
    if last is None and not (are_countable(frames.name) and are_countable(patch_rows.name)):
        raise DamagedRowError(f"{node} {patch.patch_id}")
    found["coverage"] = 1.0 if last is None else last.coverage
    strides = (last.strides if last is not None else b"") or bytes(len(patch.taxels))
    dt = 0 if last is None else last.dt
    return [
        found | {"channel": channel, "column": column, "dt": dt << strides[column]}
        for column, channel in enumerate(patch.channels)
    ]


def _last_run(connection: Connection, totals: Channel) -> PatchRun | None:
    """The latest run of a patch, which need not be in each frame of its page."""
    last, first = totals["t_last"], totals["t_first"]
    if last is None:
        return None
    span = max(totals["longest"], 1)
    while True:
        window = Window(before(last, span), last + 1)
        place = totals["node"], totals["patch"]
        runs = decode_rows(connection, *place, [window], lambda row: decode_heads(row["data"]))
        runs += read_fresh(connection, *place, [window])
        if runs or window.start <= first:
            return max(runs, key=lambda run: (run.t, run.boot, run.sequence), default=None)
        span *= _WIDER


def read_column(connection: Connection, channel: Channel, *windows: Window) -> ColumnRuns:
    """The runs of a channel with samples in any window, in order of time, boot and sequence.

    Args:
        connection: In a read transaction.
        channel: The channel.
        windows: The windows.
    """
    node, taxel = channel["node"], channel["channel"].partition(".")[0]
    places: dict[bytes, tuple[int, int] | None] = {}

    def place_in(patch: bytes) -> tuple[int, int] | None:
        if patch not in places:
            places[patch] = _place(find_patch(connection, node, patch), taxel)
        return places[patch]

    def decode(row: RowMapping) -> list[ColumnRuns]:
        place = place_in(bytes(row["hash"]))
        if place is None:
            return []
        runs = decode_column(row["data"], place[0])
        return [replace(runs, t=runs.t + place[1]) if place[1] else runs]

    compacted = decode_rows(connection, node, channel["patch"], windows, decode)
    fresh = [
        column
        for run in read_fresh(connection, node, channel["patch"], windows)
        if (place := place_in(run.patch)) is not None
        and (column := column_of(run, *place)) is not None
    ]
    found = ColumnRuns.joined([*compacted, ColumnRuns.of(fresh)]).sorted()
    seen = np.zeros(len(found), np.bool_)
    for window in windows:
        first, last = found.clipped(window.start, window.end)
        seen |= first <= last
    return found.chosen(np.flatnonzero(seen))


def count_samples(connection: Connection, channel: Channel, window: Window) -> int:
    """The number of a channel's samples in a window."""
    total = 0
    for part in split_column(connection, channel, window):
        first, last = read_column(connection, channel, part).clipped(part.start, part.end)
        total += int((last - first + 1).sum())
    return total


def split_column(connection: Connection, channel: Channel, window: Window) -> Iterator[Window]:
    """Split a window into those whose samples fit the memory."""
    return split_by_rows(connection, channel["node"], channel["patch"], window)


def next_rows(connection: Connection, channel: Channel, instant: int) -> int | None:
    """When the first row that may hold a channel begins, from a time on; ``None`` if none does."""
    window = Window(instant, MOST_INSTANT)
    return first_start(connection, channel["node"], channel["patch"], window)


def previous_rows(connection: Connection, channel: Channel, instant: int) -> int | None:
    """When the last row that may hold a channel begins, before a time; ``None`` if none does."""
    return last_start(connection, channel["node"], channel["patch"], instant)


def _place(patch: Patch, taxel: str) -> tuple[int, int] | None:
    """The column of a taxel, and its skew; ``None`` if the patch did not have it."""
    if taxel not in patch.taxels:
        return None
    column = patch.taxels.index(taxel)
    return column, patch.skew[column] if patch.skew else 0


def column_of(run: PatchRun, column: int, skew: int) -> ColumnRun | None:
    """A column of a run, whose samples are ``skew`` ns later; ``None`` if no row has one of it."""
    step = 1 << run.strides[column] if run.strides else 1
    first = -run.first_row % step
    lo = run.lo[first::step, column]
    if not lo.size:
        return None
    return ColumnRun(
        t=run.t + first * run.dt + skew,
        boot=run.boot,
        sequence=run.sequence,
        dt=run.dt * step,
        error=run.error,
        coverage=run.coverage,
        lo=lo,
        hi=run.hi[first::step, column],
    )
