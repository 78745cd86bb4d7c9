"""Frames against the truth, all patches of many frames at once."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from cachetools import LRUCache
from eskin_cloud.store.damage import FrameHeader, PatchRowHeader, is_intact_row
from eskin_cloud.store.descriptions import find_layout, find_patch
from eskin_cloud.store.frame_row import FrameRow, fit_frame
from eskin_cloud.store.patch_rows import decode_runs
from eskin_cloud.store.schema.frame_tables import frames, patch_rows
from eskin_cloud.store.schema.sealed_tables import removals
from eskin_cloud.store.write.removal_counts import RemovalReason
from eskin_sensor_node.node.ground_truth import GroundTruth, TrueFrame
from sqlalchemy import func, select, tuple_

from eskin.demo.audit.channel import ChannelAudit
from eskin.demo.audit.sealed import has_columns, open_frame, sealed_rows
from eskin.errors import AuditError
from eskin.interval import Interval
from eskin.monitor import SharedError
from eskin.privacy.sealed_message import name_place
from eskin.wire.frames import EncodedFrame, Sampling
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin.wire.messages import Position
from eskin.wire.slot import slot_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from eskin_cloud.store.patch_run import PatchRun
    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin.interval import Floats
    from eskin.privacy import Decryptor
    from eskin.wire.frames import DescribedLayout, Patch

    Integers = NDArray[np.int64]

_FRAMES: Final = 128
"""Frames, or rows of patches, in memory at once."""
_TRUTHS: Final = 2048
"""Frames whose truth stays in memory for the rows of their other patches."""
_COMPARED: Final = [c for c in FrameRow._fields if c not in {"cursor", "received", "data"}]


class StoredFrames(NamedTuple):
    """What the store holds of a node's frames.

    Attributes:
        patches: One entry a patch.
        complete: Positions of frames of which all patches are stored, also sealed.
        parts: How many patches are stored of each frame that was compacted.
        doubled: Positions of frames of which a patch is stored twice.
    """

    patches: list[ChannelAudit]
    complete: set[Position]
    parts: Mapping[Position, int]
    doubled: list[Position]


def count_frames(connection: Connection) -> dict[str, int]:
    """Rows of frames and of their patches, by node."""
    found: Counter[str] = Counter()
    for table in (frames, patch_rows):
        query = select(table.c.node, func.count()).group_by(table.c.node)
        found.update({node: int(count) for node, count in connection.execute(query)})
    return dict(found)


def audit_frames(
    path: Path,
    connection: Connection,
    node: str,
    progress: Callable[[int], None],
    *,
    reader: Decryptor | None,
) -> StoredFrames:
    """Compare all frames of a node with the truth.

    Args:
        path: Of the truth.
        connection: Reads the store.
        node: The node.
        progress: Takes how many rows are done more.
        reader: Opens sealed frames; ``None`` where the store has none.

    Raises:
        AuditError: There is no truth behind a frame, and there never was.
    """
    found = _Comparison(path, connection, node)
    if reader is not None:
        for rows in sealed_rows(connection, node, _FRAMES):
            found.compare_sealed(rows, reader)
            progress(len(rows))
    for rows in _frame_rows(connection, node):
        found.compare_frames(rows)
        progress(len(rows))
    for rows in _patch_rows(connection, node):
        found.compare_patches(rows)
        progress(len(rows))
    return found.result()


def removed_frames(
    path: Path,
    connection: Connection,
    node: str,
    gone: Sequence[Position],
    parts: Mapping[Position, int],
) -> set[Position]:
    """Which of the missing or incomplete frames were removed by their age, or with their subject.

    Args:
        path: Of the truth.
        connection: Reads the store.
        node: The node.
        gone: The frames.
        parts: How many of their patches are stored.
    """
    r = removals.c
    query = select(r.place, r.reason, r.messages, r.before).where(r.node == node)
    records = defaultdict(list)
    for name, reason, messages, before in connection.execute(query):
        records[name].append((reason, messages, before))
    found: dict[Position, list[str]] = {}
    counts: Counter[str] = Counter()
    for position, truth in GroundTruth.read_frames(path, gone, node=node).items():
        names = _removable(find_layout(connection, node, truth.layout), truth)
        removed = [
            name
            for name in names
            if any(why == RemovalReason.ERASURE or truth.end < end for why, _, end in records[name])
        ]
        if len(removed) + parts.get(position, 0) >= len(names):
            found[position] = removed
            counts.update(removed)
    # Removal excuses no more than it removed, and which ones cannot be known.
    limits = {name: sum(messages for _, messages, _ in each) for name, each in records.items()}
    return {
        position
        for position, names in found.items()
        if all(counts[name] <= limits[name] for name in names)
    }


def _removable(described: DescribedLayout, truth: TrueFrame) -> list[str]:
    """The names under which the store states the removal of a frame, or of its patches."""
    numbers = truth.sizes[:, 0].tolist()
    page = next(p for p, on_page in enumerate(described.page_ranges) if numbers[0] in on_page)
    if page in described.biometric_pages:
        return [name_place((truth.layout, page))]
    return [described.patches[number].patch_id for number in numbers]


@dataclass(slots=True)
class _Sums:
    """Sums over the samples of each patch of a layout."""

    described: DescribedLayout
    counts: dict[str, Integers] = field(default_factory=dict)
    amounts: dict[str, Floats] = field(default_factory=dict)
    coverage: Floats = field(init=False)
    factors: dict[tuple[int, int], tuple[Floats, Floats]] = field(default_factory=dict)
    """By patch and epoch, between which bounds the factor of each column must lie."""

    def __post_init__(self) -> None:
        patches = len(self.described.patches)
        names = ("frames", "samples", "violations", "late", "unbounded", "forgotten", "mislabelled")
        self.counts = {name: np.zeros(patches, np.int64) for name in (*names, "contradictions")}
        self.amounts = {name: np.zeros(patches) for name in ("width", "magnitude")}
        self.coverage = np.ones(patches)

    def compare(
        self, numbers: Integers, begins: Integers, lo: Floats, hi: Floats, truth: Floats
    ) -> None:
        """Add samples of patches.

        Args:
            numbers: Of the patches, ascending in no order, some of them several times.
            begins: Where the samples of each begin.
            lo: Lower bounds of all cells.
            hi: Upper bounds.
            truth: True values.
        """
        bounded = np.isfinite(lo) & np.isfinite(hi)
        # A cell without a sample has no truth: its column is sampled in fewer rows.
        sampled = ~(np.isnan(truth) & np.isneginf(lo) & np.isposinf(hi))
        broken = sampled & ~((lo <= truth) & (truth <= hi))
        width = np.where(bounded, hi, 0.0) - np.where(bounded, lo, 0.0)
        magnitude = np.where(bounded, np.abs(truth), 0.0)
        sums = {"samples": sampled, "violations": broken, "unbounded": sampled & ~bounded}
        self.count("frames", numbers)
        for name, flags in sums.items():
            np.add.at(self.counts[name], numbers, np.add.reduceat(flags, begins, dtype=np.int64))
        for name, values in {"width": width, "magnitude": magnitude}.items():
            np.add.at(self.amounts[name], numbers, np.add.reduceat(values, begins))

    def share(self, number: int, epoch: int, lo: Floats, hi: Floats, truth: Floats) -> None:
        """Narrow the factor α of each column to what explains some true values: ``x = α·u``.

        Args:
            number: Of the patch.
            epoch: In which α is constant.
            lo: Lower bounds, rows × columns.
            hi: Upper bounds.
            truth: True values.
        """
        patch = self.described.patches[number]
        if set(patch.beta) != {(0.0, 0.0)}:  # no emulated kind states a summand
            return
        alpha = np.broadcast_to(np.array(patch.alpha), (len(patch.taxels), 2)).T
        low, high = self.factors.setdefault((number, epoch), (alpha[0].copy(), alpha[1].copy()))
        for k, (least, most) in enumerate(alpha.T.tolist()):
            x = truth[:, k]
            known = np.isfinite(lo[:, k]) & np.isfinite(hi[:, k]) & (x > 0.0)
            error = SharedError((least, most))
            own, found = error.own_parts(Interval(lo[known, k], hi[known, k]))
            kept = found & (own.inf > 0.0)
            if np.any(kept):
                factor = Interval(x[known][kept]) / own[kept]
                low[k] = max(low[k], float(factor.inf.max()))
                high[k] = min(high[k], float(factor.sup.min()))

    def count(self, name: str, numbers: Integers | Sequence[int]) -> None:
        """Count one for each patch."""
        np.add.at(self.counts[name], numbers, 1)

    def entries(self, node: str) -> Iterator[ChannelAudit]:
        """One entry for each patch with stored samples."""
        for (number, _), (low, high) in self.factors.items():
            if self.coverage[number] == 1.0:
                self.counts["contradictions"][number] += int((low > high).sum())
        self.factors.clear()
        for number, patch in enumerate(self.described.patches):
            counts: dict[str, Any] = {name: int(each[number]) for name, each in self.counts.items()}
            if any(counts.values()):
                amounts: dict[str, Any] = {k: float(v[number]) for k, v in self.amounts.items()}
                entry = ChannelAudit(node, _channel(patch), patch.unit, **counts, **amounts)
                entry.coverage = float(self.coverage[number])
                yield entry


class _Stored(NamedTuple):
    """A frame from the store.

    Attributes:
        frame: The frame.
        fits: Whether its row's columns are its own.
    """

    frame: EncodedFrame
    fits: bool


class _Comparison:
    """Compares rows of one node."""

    def __init__(self, path: Path, connection: Connection, node: str) -> None:
        self._path, self._connection, self._node = path, connection, node
        self._sums: dict[bytes, _Sums] = {}
        self._truths: LRUCache[Position, TrueFrame | None] = LRUCache(_TRUTHS)
        self._whole: set[Position] = set()
        self._parts: Counter[Position] = Counter()
        self._patches: dict[Position, int] = {}
        self._forgotten: dict[str, ChannelAudit] = {}

    def compare_frames(self, rows: Sequence[RowMapping]) -> None:
        """Compare rows of frames."""
        found: list[_Stored] = []
        for row in rows:
            self._whole.add(_position(row))
            if is_intact_row(FrameHeader, row):
                frame = EncodedFrame.decode(bytes(row["data"]))
                found.append(_Stored(frame, self._has_columns(row, frame)))
        self._compare(found)

    def compare_sealed(self, rows: Sequence[RowMapping], reader: Decryptor) -> None:
        """Compare rows of sealed frames; those of erased subjects are left out."""
        found: list[_Stored] = []
        for row in rows:
            self._whole.add(_position(row))
            frame = open_frame(reader, row)
            if frame is not None:
                found.append(_Stored(frame, has_columns(row, frame)))
        self._compare(found)

    def compare_patches(self, rows: Sequence[RowMapping]) -> None:
        """Compare rows into which frames were compacted."""
        for row in rows:
            if is_intact_row(PatchRowHeader, row):
                self._compare_runs(row, decode_runs(row["data"]))

    def result(self) -> StoredFrames:
        """What was found."""
        entries = self._forgotten
        for sums in self._sums.values():
            for entry in sums.entries(self._node):
                known = entries.setdefault(entry.channel, entry)
                if known is not entry:
                    known.add(entry)
        parts = self._parts.items()
        complete = {place for place, count in parts if count >= self._patches[place]}
        # Compaction moves a frame as a whole.
        doubled = self._whole & self._parts.keys()
        doubled |= {place for place, count in parts if count > self._patches[place]}
        whole = self._whole | complete
        return StoredFrames(list(entries.values()), whole, self._parts, sorted(doubled))

    def _sums_of(self, layout: bytes) -> _Sums:
        if layout not in self._sums:
            self._sums[layout] = _Sums(find_layout(self._connection, self._node, layout))
        return self._sums[layout]

    def _compare(self, found: Sequence[_Stored]) -> None:
        by_layout: dict[bytes, list[_Stored]] = {}
        for each in found:
            by_layout.setdefault(each.frame.layout, []).append(each)
        for name, alike in by_layout.items():
            self._compare_alike(self._sums_of(name), alike)

    def _compare_alike(self, sums: _Sums, found: Sequence[_Stored]) -> None:
        """Compare frames of one layout."""
        truths = self._find([each.frame.position for each in found])
        known: list[tuple[_Stored, TrueFrame]] = []
        for each in found:
            numbers = each.frame.records["patch"]
            truth = truths[each.frame.position]
            if truth is None:
                sums.count("forgotten", numbers)
            elif each.fits and _is_alike(each.frame, truth):
                known.append((each, truth))
            else:
                sums.count("mislabelled", numbers)
        if not known:
            return
        wanted = np.ones(len(sums.described.patches), np.bool_)
        records = scan_frames([each.frame.data for each, _ in known], wanted)
        whole = records.whole
        values = np.concatenate([truth.values for _, truth in known])
        numbers = whole[:, Part.PATCH]
        sums.compare(numbers, whole[:, Part.BEGIN], records.lo, records.hi, values)
        np.minimum.at(sums.coverage, numbers, records.coverage)
        for record in np.flatnonzero(whole[:, Part.EPOCH]).tolist():
            number, epoch, begin, rows, columns = whole[
                record, [Part.PATCH, Part.EPOCH, Part.BEGIN, Part.ROWS, Part.COLUMNS]
            ].tolist()
            cells = slice(begin, begin + rows * columns)
            parts = (
                each[cells].reshape(rows, columns) for each in (records.lo, records.hi, values)
            )
            sums.share(number, epoch, *parts)
        times = np.array([(truth.time, truth.end, truth.lasting) for _, truth in known])
        time, end, lasting = times[whole[:, Part.FRAME]].T
        earliest, latest = whole[:, Part.EARLIEST], whole[:, Part.LATEST]
        inside = (earliest <= time) & (time <= latest)
        inside &= (earliest + lasting <= end) & (end <= latest + lasting)
        sums.count("late", numbers[~inside])

    def _has_columns(self, row: RowMapping, frame: EncodedFrame) -> bool:
        """Whether the columns of a row are those of its frame."""
        fitting = fit_frame(frame, self._sums_of(frame.layout).described)
        digest = bytes(row["digest"])
        own = FrameRow.of(self._node, frame, fitting, digest, cursor=0, now=0)
        return all(getattr(own, name) == row[name] for name in _COMPARED)

    def _compare_runs(self, row: RowMapping, runs: Sequence[PatchRun]) -> None:
        """Compare one row of a patch."""
        truths = self._find([Position(run.boot, run.sequence) for run in runs])
        masks = [
            Sampling(len(run.lo), run.lo.shape[1], run.first_row, run.strides).mask for run in runs
        ]
        samples = sum(int(mask.sum()) for mask in masks)
        found = list(zip(runs, masks, strict=True))
        hull = (
            min(float(run.lo[mask].min()) for run, mask in found),
            max(float(run.hi[mask].max()) for run, mask in found),
        )
        coverage = min(run.coverage for run in runs)
        fits = (row["frames"], row["samples"], row["lo"], row["hi"], row["coverage"]) == (
            *(len(runs), samples), *hull, coverage
        )  # fmt: skip
        for run in runs:
            place = Position(run.boot, run.sequence)
            truth = truths[place]
            if truth is None:
                self._forget(run.patch)
                continue
            sums = self._sums_of(truth.layout)
            number = sums.described.layout.patches.index(run.patch)
            self._parts[place] += 1
            self._patches[place] = len(truth.sizes)
            at = np.flatnonzero(truth.sizes[:, 0] == number)
            if not fits or len(at) != 1 or truth.sizes[at[0], 1] != run.lo.size:
                sums.count("mislabelled", [number])
                continue
            begin = int(truth.sizes[: at[0], 1].sum())
            values = truth.values[begin : begin + run.lo.size]
            one, start = np.array([number]), np.zeros(1, np.int64)
            sums.compare(one, start, run.lo.ravel(), run.hi.ravel(), values)
            sums.coverage[number] = min(sums.coverage[number], run.coverage)
            if run.epoch:
                sums.share(number, run.epoch, run.lo, run.hi, values.reshape(run.lo.shape))
            since = run.ticks - truth.ticks
            off = truth.time + since - run.t, truth.end - truth.lasting + since - run.t
            if max(map(abs, off)) > run.error:
                sums.count("late", [number])

    def _forget(self, name: bytes) -> None:
        """Count samples of a patch, by the hash of its description, whose truth was dropped."""
        patch = find_patch(self._connection, self._node, name)
        entry = ChannelAudit(self._node, _channel(patch), patch.unit)
        self._forgotten.setdefault(entry.channel, entry).forgotten += 1

    def _find(self, positions: Sequence[Position]) -> dict[Position, TrueFrame | None]:
        """The truth behind frames; ``None`` where it was dropped.

        Raises:
            AuditError: There never was any.
        """
        missing = [each for each in dict.fromkeys(positions) if each not in self._truths]
        found = GroundTruth.read_frames(self._path, missing, node=self._node)
        result: dict[Position, TrueFrame | None] = {}
        for position in dict.fromkeys(positions):
            truth = found.get(position)
            if position in self._truths:
                truth = self._truths[position]
            elif truth is None and not self._is_dropped(position):
                raise AuditError(f"{self._path}: no truth behind {position} of {self._node!r}")
            result[position] = truth
        for position in missing:
            self._truths[position] = result[position]
        return result

    def _is_dropped(self, position: Position) -> bool:
        oldest = GroundTruth.oldest(self._path, node=self._node)
        return oldest is not None and position < oldest


def _is_alike(frame: EncodedFrame, truth: TrueFrame) -> bool:
    """Whether a frame is the one that was made."""
    records = frame.records
    rows = np.array([grid.rows for grid in frame.grids])[records["grid"]]
    sizes = np.stack([records["patch"], rows * records["columns"]], axis=1)
    return (
        (frame.position, frame.layout) == (truth.position, truth.layout)
        and frame.ticks == truth.ticks
        and np.array_equal(sizes, truth.sizes)
    )


def _channel(patch: Patch) -> str:
    return f"{patch.patch_id}.{patch.quantity}"


def _position(row: RowMapping) -> Position:
    return Position(row["boot"], row["sequence"])


def _frame_rows(connection: Connection, node: str) -> Iterator[Sequence[RowMapping]]:
    """The node's frames in order."""
    f, last = frames.c, (-1, -1)
    while True:
        query = (
            select(frames)
            .where(f.slot == slot_of(node), f.node == node, tuple_(f.boot, f.sequence) > last)
            .order_by(f.boot, f.sequence)
            .limit(_FRAMES)
        )
        rows = connection.execute(query).mappings().all()
        if not rows:
            return
        yield rows
        last = _position(rows[-1])


def _patch_rows(connection: Connection, node: str) -> Iterator[Sequence[RowMapping]]:
    """The node's rows of patches, in order of time: those of the same frames together."""
    r = patch_rows.c
    key = r.t, r.patch, r.boot, r.sequence
    last: tuple[int | str, ...] = (-(2**63), "", -1, -1)
    while True:
        query = (
            select(patch_rows)
            .where(r.slot == slot_of(node), r.node == node, tuple_(*key) > last)
            .order_by(*key)
            .limit(_FRAMES)
        )
        rows = connection.execute(query).mappings().all()
        if not rows:
            return
        yield rows
        last = tuple(rows[-1][column.name] for column in key)
