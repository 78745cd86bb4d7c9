"""Read the samples of a patch: from frames, and from the rows that compaction made of them."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import numpy as np
from sqlalchemy import and_, bindparam, func, select

from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin.wire.slot import slot_of
from eskin_cloud.store.damage import (
    DamagedRowError,
    FrameHeader,
    PatchRowHeader,
    are_countable,
    is_intact_row,
)
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.patch_rows import decode_runs
from eskin_cloud.store.patch_run import PatchRun
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.row_digests import intact_rows, require_intact_row
from eskin_cloud.store.schema.frame_tables import frames, pages, patch_rows, patches
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin.wire.frames import DescribedLayout

Decoded = TypeVar("Decoded")

FRAMES_AT_ONCE: Final = 512
ROWS_AT_ONCE: Final = 32
"""Frames, and compacted rows of at least 10 s, whose samples are held at once."""


def _here(table: Any) -> Any:
    return and_(table.c.slot == bindparam("slot"), table.c.node == bindparam("node"))


def _overlapping(table: Any) -> Any:
    return and_(
        table.c.t >= bindparam("earliest"),
        table.c.t < bindparam("end"),
        table.c.t_end >= bindparam("start"),
    )


_PAGES: Final = select(pages).where(_here(pages))
_PATCH: Final = select(patches).where(_here(patches), patches.c.patch == bindparam("patch"))
_COMPACTED: Final = select(patches.c.patch).where(_here(patches))
_FRAMES: Final = (
    select(frames)
    .where(_here(frames), frames.c.page == bindparam("page"), _overlapping(frames))
    .order_by(frames.c.t, frames.c.boot, frames.c.sequence)
)
_ROWS: Final = (
    select(patch_rows)
    .where(_here(patch_rows), patch_rows.c.patch == bindparam("patch"), _overlapping(patch_rows))
    .order_by(patch_rows.c.t, patch_rows.c.boot, patch_rows.c.sequence)
)
_FRAME_STARTS: Final = (
    select(frames.c.t)
    .where(
        _here(frames),
        frames.c.page == bindparam("page"),
        frames.c.t >= bindparam("start"),
        frames.c.t < bindparam("end"),
    )
    .order_by(frames.c.t)
    .limit(FRAMES_AT_ONCE)
)
_ROW_STARTS: Final = (
    select(patch_rows.c.t)
    .where(
        _here(patch_rows),
        patch_rows.c.patch == bindparam("patch"),
        patch_rows.c.t >= bindparam("start"),
        patch_rows.c.t < bindparam("end"),
    )
    .order_by(patch_rows.c.t)
    .limit(ROWS_AT_ONCE)
)


def _last_start(table: Any, name: str) -> Any:
    return select(func.max(table.c.t)).where(
        _here(table), table.c[name] == bindparam(name), table.c.t < bindparam("end")
    )


_LAST_FRAME_START: Final = _last_start(frames, "page")
_LAST_ROW_START: Final = _last_start(patch_rows, "patch")


class PatchPage(NamedTuple):
    """A page whose frames hold a patch.

    Attributes:
        described: The layout.
        page: Number of the page.
        number: Number of the patch in the layout.
        totals: The page's row in `schema.frame_tables.pages`.
    """

    described: DescribedLayout
    page: int
    number: int
    totals: RowMapping


def read_pages(connection: Connection, node: str, *, strict: bool = False) -> list[RowMapping]:
    """The totals of a node's pages; those of the latest layout come first.

    Args:
        connection: In a read transaction.
        node: The node.
        strict: Whether damaged totals are an error; else they are reported and dropped.

    Raises:
        DamagedRowError: Totals are damaged.
    """
    are_countable(pages.name)  # a row whose key is damaged is not found by it; this reports it
    rows = connection.execute(_PAGES, {"slot": slot_of(node), "node": node}).mappings().all()
    found = intact_rows(connection, pages, rows)
    if strict and len(found) < len(rows):
        raise DamagedRowError(f"totals of the pages of {node}")
    return sorted(found, key=lambda row: (row["t_last"] is None, -(row["t_last"] or 0)))


def find_last(connection: Connection, node: str, *, sealed: bool = False) -> int | None:
    """The time of a node's last sample in frames, UTC ns; ``None`` if there is none.

    Unless ``sealed``, it does not depend on sealed frames, of which only the minute is known.
    """
    times = [
        row["t_last"]
        for row in read_pages(connection, node)
        if row["t_last"] is not None and (sealed or not _is_sealed(connection, node, row))
    ]
    return max(times, default=None)


def _is_sealed(connection: Connection, node: str, page: RowMapping) -> bool:
    described = find_layout(connection, node, bytes(page["layout"]))
    return page["page"] in described.biometric_pages


def find_layouts(connection: Connection, node: str) -> list[DescribedLayout]:
    """The layouts that a node's frames are read by, from the latest on.

    Raises:
        UnknownDescriptionError: One is damaged in the store.
    """
    latest = connection.execute(select(nodes.c.layout).where(of_node(nodes, node))).scalar()
    names = [] if latest is None else [bytes(latest)]
    names += [bytes(row["layout"]) for row in read_pages(connection, node)]
    return [find_layout(connection, node, name) for name in dict.fromkeys(names)]


def read_patch(connection: Connection, node: str, patch_id: str) -> RowMapping | None:
    """The totals of a patch's compacted rows; ``None`` if it has none.

    Raises:
        DamagedRowError: They are damaged.
    """
    are_countable(patches.name)  # as for pages
    key = {"slot": slot_of(node), "node": node, "patch": patch_id}
    row = connection.execute(_PATCH, key).mappings().one_or_none()
    return require_intact_row(connection, patches, row)


def find_patch_pages(
    connection: Connection, node: str, patch_id: str, *, strict: bool = False
) -> list[PatchPage]:
    """The pages whose frames hold a patch; ``strict`` is that of `read_pages`.

    Raises:
        UnknownDescriptionError: A layout is damaged in the store.
        DamagedRowError: Totals are damaged.
    """
    found = []
    for row in read_pages(connection, node, strict=strict):
        described = find_layout(connection, node, bytes(row["layout"]))
        found += [
            PatchPage(described, row["page"], number, row)
            for number in described.page_ranges[row["page"]]
            if described.patches[number].patch_id == patch_id
        ]
    return found


def read_runs(connection: Connection, node: str, patch_id: str, window: Window) -> list[PatchRun]:
    """The runs of a patch in a window, in order of time, boot and sequence.

    Some may lie outside of the window: a row is read as a whole, and a frame's time is that of its
    page. Damaged rows are reported, and their samples are missing.

    Args:
        connection: In a read transaction.
        node: The node.
        patch_id: The patch, whatever its description was.
        window: The window.

    Raises:
        UnknownDescriptionError: A layout is damaged in the store.
        DamagedRowError: The patch's totals are damaged.
    """
    found = read_compacted(connection, node, patch_id, window)
    found += read_fresh(connection, node, patch_id, [window])
    return sorted(found, key=lambda run: (run.t, run.boot, run.sequence))


def read_fresh(
    connection: Connection, node: str, patch_id: str, windows: Iterable[Window]
) -> list[PatchRun]:
    """The runs of a patch in frames that are not compacted, in any order, each once.

    Otherwise as `read_runs`, in some windows.
    """
    windows = list(windows)
    found: list[PatchRun] = []
    places: dict[int, list[PatchPage]] = defaultdict(list)
    for place in find_patch_pages(connection, node, patch_id):
        places[place.page].append(place)
    for page, of_page in places.items():
        longest = max(place.totals["longest"] for place in of_page)
        named = {
            (row["boot"], row["sequence"]): row
            for window in windows
            for row in read_frame_rows(connection, node, page, window, longest)
        }
        rows = list(named.values())
        for place in of_page:
            mine = [row for row in rows if bytes(row["layout"]) == place.described.hash]
            if mine:
                found += (run for _, run in runs_of_frames(mine, place.described, [place.number]))
    return found


def read_compacted(
    connection: Connection, node: str, patch_id: str, window: Window
) -> list[PatchRun]:
    """The runs of a patch in its compacted rows, in any order; otherwise as `read_runs`."""
    return decode_rows(connection, node, patch_id, [window], lambda row: decode_runs(row["data"]))


def decode_rows(
    connection: Connection,
    node: str,
    patch_id: str,
    windows: Iterable[Window],
    decode: Callable[[RowMapping], list[Decoded]],
) -> list[Decoded]:
    """What is in the compacted rows of a patch, in any order, each row once.

    Otherwise as `read_runs`.

    Args:
        connection: In a read transaction.
        node: The node.
        patch_id: The patch.
        windows: Where the rows have samples.
        decode: Reads an intact row.
    """
    totals = read_patch(connection, node, patch_id)
    if totals is None:
        return []
    key = {"slot": slot_of(node), "node": node, "patch": patch_id}
    are_countable(patch_rows.name)
    rows = {
        (row["t"], row["boot"], row["sequence"]): row
        for window in windows
        for row in connection.execute(_ROWS, key | _bounds(window, totals["longest"])).mappings()
    }
    intact = (row for row in rows.values() if is_intact_row(PatchRowHeader, row))
    return [each for row in intact for each in decode(row)]


def read_described_runs(
    connection: Connection,
    node: str,
    described: DescribedLayout,
    numbers: Sequence[int],
    window: Window,
) -> dict[int, list[PatchRun]]:
    """The runs of many patches in a window, by their numbers; only those of these descriptions.

    Each frame is decoded once for all of its patches. Otherwise as `read_runs`.

    Args:
        connection: In a read transaction.
        node: The node.
        described: The layout that describes the patches.
        numbers: Of the patches in that layout.
        window: The window.
    """
    names = {described.layout.patches[number]: number for number in numbers}
    found: dict[int, list[PatchRun]] = {number: [] for number in names.values()}
    key = {"slot": slot_of(node), "node": node}
    compacted = set(connection.execute(_COMPACTED, key).scalars())
    for name, number in names.items():
        patch_id = described.patches[number].patch_id
        if patch_id in compacted:  # not asked of each patch: a skin has many
            rows = read_compacted(connection, node, patch_id, window)
            found[number] = [run for run in rows if run.patch == name]
    for row in read_pages(connection, node):
        other = find_layout(connection, node, bytes(row["layout"]))
        mine = [k for k in other.page_ranges[row["page"]] if other.layout.patches[k] in names]
        if not mine:
            continue
        frame_rows = read_frame_rows(connection, node, row["page"], window, row["longest"])
        of_layout = [each for each in frame_rows if bytes(each["layout"]) == other.hash]
        if of_layout:
            for _, run in runs_of_frames(of_layout, other, mine):
                found[names[run.patch]].append(run)
    for runs in found.values():
        runs.sort(key=lambda run: (run.t, run.boot, run.sequence))
    return found


def read_frame_rows(
    connection: Connection, node: str, page: int, window: Window, longest: int
) -> list[RowMapping]:
    """The intact rows of a page's frames in a window, in order of time.

    Args:
        connection: In a read transaction.
        node: The node.
        page: The page, of whatever layout.
        window: The window.
        longest: The longest span of such a row, ns.
    """
    key = {"slot": slot_of(node), "node": node, "page": page} | _bounds(window, longest)
    are_countable(frames.name)
    rows = connection.execute(_FRAMES, key).mappings()
    return [row for row in rows if is_intact_row(FrameHeader, row)]


def split_by_rows(
    connection: Connection, node: str, patch_id: str, window: Window
) -> Iterator[Window]:
    """Split a window into those in which only so many rows of a patch begin as fit the memory."""
    at = window.start
    while at < window.end:
        starts = _read_starts(connection, node, patch_id, Window(at, window.end))
        full = [each[-1] for each, most in starts if len(each) == most]
        end = max(min(full), at + 1) if full else window.end
        yield Window(at, end)
        at = end


def first_start(connection: Connection, node: str, patch_id: str, window: Window) -> int | None:
    """When the first row begins in a window that may hold a patch; ``None`` if none does."""
    starts = _read_starts(connection, node, patch_id, window)
    return min((each[0] for each, _ in starts if each), default=None)


def last_start(connection: Connection, node: str, patch_id: str, end: int) -> int | None:
    """When the last row begins before a time that may hold a patch; ``None`` if none does."""
    key = {"slot": slot_of(node), "node": node, "patch": patch_id, "end": end}
    of_pages = sorted({each.page for each in find_patch_pages(connection, node, patch_id)})
    asked = [(_LAST_ROW_START, key), *((_LAST_FRAME_START, key | {"page": p}) for p in of_pages)]
    found = [connection.execute(statement, values).scalar() for statement, values in asked]
    return max((each for each in found if each is not None), default=None)


def _read_starts(
    connection: Connection, node: str, patch_id: str, window: Window
) -> list[tuple[Sequence[int], int]]:
    """When rows begin that may hold a patch, by kind of row; and how many are read at most."""
    key = {"slot": slot_of(node), "node": node, "patch": patch_id}
    key |= {"start": window.start, "end": window.end}
    found = [(connection.execute(_ROW_STARTS, key).scalars().all(), ROWS_AT_ONCE)]
    for page in sorted({each.page for each in find_patch_pages(connection, node, patch_id)}):
        starts = connection.execute(_FRAME_STARTS, key | {"page": page}).scalars().all()
        found.append((starts, FRAMES_AT_ONCE))
    return found


def _bounds(window: Window, longest: int) -> dict[str, int]:
    return {
        "start": window.start,
        "end": window.end,
        "earliest": before(window.start, longest),
    }


def runs_of_frames(
    rows: Sequence[Mapping[Any, Any]], described: DescribedLayout, numbers: Sequence[int]
) -> Iterator[tuple[int, PatchRun]]:
    """The runs of some patches in frames of one layout, each with the number of its patch.

    Args:
        rows: ``boot``, ``sequence`` and ``data`` of frames, as intact rows of
            `schema.frame_tables.frames` have them.
        described: The layout.
        numbers: Of the patches in the layout.
    """
    wanted = np.zeros(max(numbers) + 1, np.bool_)
    wanted[list(numbers)] = True
    records = scan_frames([row["data"] for row in rows], wanted)
    coverage = records.coverage.tolist()
    for record, whole in enumerate(records.whole.tolist()):
        row, number = rows[whole[Part.FRAME]], whole[Part.PATCH]
        shape = whole[Part.ROWS], whole[Part.COLUMNS]
        cells = slice(whole[Part.BEGIN], whole[Part.BEGIN] + shape[0] * shape[1])
        earliest, latest = whole[Part.EARLIEST], whole[Part.LATEST]
        yield (
            number,
            PatchRun(
                patch=described.layout.patches[number],
                boot=row["boot"],
                sequence=row["sequence"],
                ticks=whole[Part.TICKS] + whole[Part.DELAY],
                t=(earliest + latest) // 2 + whole[Part.DELAY],
                error=(latest - earliest + 1) // 2,
                dt=whole[Part.PERIOD],
                first_row=whole[Part.FIRST_ROW],
                strides=records.strides(record),
                epoch=whole[Part.EPOCH],
                unshared=records.unshared(record),
                coverage=coverage[record],
                lo=records.lo[cells].reshape(shape),
                hi=records.hi[cells].reshape(shape),
            ),
        )
