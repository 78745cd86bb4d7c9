"""The contacts of a skin at one instant, from frames."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from eskin.contacts import Skin, find_contacts
from eskin.wire.frames import Sampling
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin_cloud.store.read.patch_runs import find_last, read_described_runs
from eskin_cloud.store.read.window import Window, before

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.contacts import Contacts
    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout, Patch
    from eskin_cloud.store.descriptions import SkinShare
    from eskin_cloud.store.patch_run import PatchRun

UNIT: Final = "Pa"
LONGEST_HOLD: Final = 2_000_000_000
"""An earlier sample counts for an instant no longer than this, in ns, whatever its period is."""
_MICROMETRE: Final = 1e6
_NEVER: Final = np.iinfo(np.int64).max


class Pressures:
    """What is known of all taxels of a skin at one instant.

    Attributes:
        lo: Lower bounds, ``-inf`` where nothing is known, shape ``(n,)``.
        hi: Upper bounds.
        t: Middle of the instant, UTC ns: that of the latest sample, unless it was asked for.
        error: Greatest distance of a sample's time from its middle, ns.
        known: Whether there is a sample.
    """

    def __init__(self, taxels: int, t: int = 0) -> None:
        self.lo = np.full(taxels, -np.inf)
        self.hi = np.full(taxels, np.inf)
        self.t = t
        self.error = 0
        self.known = False

    def put(self, taxels: NDArray[np.int64], lo: Floats, hi: Floats, error: int) -> None:
        """State some taxels."""
        self.lo[taxels], self.hi[taxels] = lo, hi
        self.error = max(self.error, error)
        self.known |= taxels.size > 0


@dataclass(frozen=True, eq=False)
class ContactSkin:
    """The taxels of a layout that have contacts, in the order of its patches.

    These are the columns of patches in Pa that state a threshold and the area of a cell.

    Attributes:
        skin: Where they are, how large, and which are neighbours.
        taxels: Their names.
        threshold: Pressure above which each is pressed, Pa, shape ``(n,)``.
        places: Of each such patch, by its number in the layout, its taxels.
    """

    skin: Skin
    taxels: tuple[str, ...]
    threshold: Floats
    places: Mapping[int, slice]

    @classmethod
    def of(cls, described: DescribedLayout) -> Self | None:
        """The skin of a layout; ``None`` if no patch has contacts.

        Raises:
            ContactError: The patches describe none.
        """
        chosen = {
            number: patch
            for number, patch in enumerate(described.patches)
            if patch.threshold is not None and patch.cell_area is not None
            and patch.positions and patch.unit == UNIT
        }  # fmt: skip
        if not chosen:
            return None
        sizes = [len(patch.taxels) for patch in chosen.values()]
        begins = dict(zip(chosen, accumulate([0, *sizes]), strict=False))
        patches = chosen.values()
        edges = [
            (begins[number] + one, begins[number] + other)
            for number, patch in chosen.items()
            for one, other in patch.neighbours
        ]
        edges += [
            (begins[seam.first] + one, begins[seam.second] + other)
            for seam in described.layout.seams
            if seam.first in chosen and seam.second in chosen
            for one, other in seam.pairs
        ]
        return cls(
            Skin.from_edges(
                _positions(patches), np.repeat([patch.cell_area for patch in patches], sizes), edges
            ),
            tuple(taxel for patch in patches for taxel in patch.taxels),
            np.repeat([float(patch.threshold or 0) for patch in patches], sizes),
            {
                number: slice(begins[number], begins[number] + len(patch.taxels))
                for number, patch in chosen.items()
            },
        )

    def read_last(self, frames: Sequence[bytes]) -> Pressures:
        """The latest sample of each taxel in frames of one stretch, a frame a page."""
        found = Pressures(len(self.taxels))
        wanted = np.zeros(max(self.places) + 1, np.bool_)
        wanted[list(self.places)] = True
        records = scan_frames(frames, wanted)
        for record, row in enumerate(records.whole.tolist()):
            rows, columns, strides = row[Part.ROWS], row[Part.COLUMNS], records.strides(record)
            taxels = np.arange(columns)
            last = np.full(columns, rows - 1)
            if strides:
                last = last_rows(Sampling(rows, columns, row[Part.FIRST_ROW], strides).mask, last)
                taxels = np.flatnonzero(last >= 0)
            cells = row[Part.BEGIN] + last[taxels] * columns + taxels
            taxels += self.places[row[Part.PATCH]].start
            earliest, latest = row[Part.EARLIEST], row[Part.LATEST]
            found.put(taxels, records.lo[cells], records.hi[cells], (latest - earliest + 1) // 2)
            t = (earliest + latest) // 2 + row[Part.DELAY] + int(last.max()) * row[Part.PERIOD]
            found.t = max(found.t, t)
        return found

    def read_at(
        self,
        connection: Connection,
        shares: Sequence[SkinShare],
        described: DescribedLayout,
        t: int,
    ) -> Pressures:
        """What is known of each taxel at an instant.

        Args:
            connection: In a read transaction.
            shares: Those of the layout; nodes that did not state it are unknown.
            described: The layout of this skin.
            t: UTC ns.
        """
        ahead = LONGEST_HOLD if len(shares) > 1 else 0
        window = Window(before(t, LONGEST_HOLD), t + 1 + ahead)
        runs: dict[int, list[PatchRun]] = {}
        for name, numbers, stated in shares:
            if stated:
                own = [number for number in numbers if number in self.places]
                runs |= read_described_runs(connection, name, described, own, window)
        return self.hold(described, runs, t, spread=len(shares) > 1)

    def hold(
        self,
        described: DescribedLayout,
        runs: Mapping[int, Sequence[PatchRun]],
        t: int,
        *,
        spread: bool,
    ) -> Pressures:
        """What each taxel's sample is at an instant: one holds until the next, a period at a gap.

        Args:
            described: The layout of this skin.
            runs: By the number of their patch, in order of time.
            t: UTC ns.
            spread: Whether the samples are of several clocks: then those are enclosed that may have
                held at ``t``, wherever in their bounds the samples' times are. Else ``t`` is the
                node's own statement, and its error is stated.
        """
        found = Pressures(len(self.taxels), t)
        for number, of_patch in runs.items():
            if of_patch:
                place, patch = self.places[number], described.patches[number]
                _put_held(found, place.start, of_patch, patch, spread=spread)
        return found

    @property
    def least(self) -> float:
        """The least threshold of all taxels, Pa."""
        return float(self.threshold.min())

    def levelled(self, bounds: Floats) -> Floats:
        """Bounds that exceed the least threshold exactly where these exceed their taxel's own.

        Those between the least and a taxel's own become the least.

        Args:
            bounds: In Pa, shape ``(…, n)``.
        """
        least = self.least
        return np.where((bounds > least) & (bounds <= self.threshold), least, bounds)

    def find(self, pressures: Pressures) -> Contacts:
        """The contacts at one instant."""
        lo, hi = self.levelled(pressures.lo), self.levelled(pressures.hi)
        return find_contacts(lo, hi, self.skin, self.least)


def find_common_end(connection: Connection, shares: Iterable[SkinShare]) -> int | None:
    """The latest time up to which all nodes of a skin have sent samples, UTC ns.

    A node that is later by `LONGEST_HOLD` than another one is silent, and is not waited for.
    """
    found = (find_last(connection, share.node) for share in shares if share.stated)
    ends = [end for end in found if end is not None]
    return min((end for end in ends if end > max(ends) - LONGEST_HOLD), default=None)


def last_rows(mask: NDArray[np.bool_], until: NDArray[np.int64]) -> NDArray[np.int64]:
    """The row of each column's last sample; -1 where it has none.

    Args:
        mask: Which cells hold a sample, shape ``(rows, columns)``.
        until: The last row that counts, for each column; -1 for none.
    """
    rows = np.arange(len(mask))[:, np.newaxis]
    return np.asarray(np.where(mask & (rows <= until), rows, -1).max(axis=0), np.int64)


def _put_held(
    found: Pressures, begin: int, runs: Sequence[PatchRun], patch: Patch, *, spread: bool
) -> None:
    """State the columns of a patch by the samples that hold at an instant, or may hold."""
    t = found.t
    skew = np.array(patch.skew or (0,) * len(patch.taxels), np.int64)
    parts = [_Times.of(run, skew, spread=spread) for run in runs]
    early, middle, late, step, sampled = (np.concatenate(each) for each in zip(*parts, strict=True))
    follows = _following(np.where(sampled, late, _NEVER))
    gap = _following(np.where(sampled, middle, _NEVER)) - middle > step + step // 2
    # Of two starts of a node, the order of samples is known only as far as their bounds go.
    current = sampled & (early <= t) & (np.maximum(follows, late + spread) > t)
    lost = np.any(current & gap & (early + step < t), axis=0)
    lost |= ~np.any(sampled & (late <= t), axis=0)
    chosen = np.flatnonzero(np.any(current, axis=0) & ~lost)
    lo, hi = (np.concatenate([getattr(run, side) for run in runs]) for side in ("lo", "hi"))
    found.put(
        begin + chosen,
        np.where(current, lo, np.inf).min(axis=0)[chosen],
        np.where(current, hi, -np.inf).max(axis=0)[chosen],
        0 if spread else max(run.error for run in runs),
    )


class _Times(NamedTuple):
    """Of each cell of a run: bounds and middle of its time, step, whether it is a sample."""

    early: NDArray[np.int64]
    middle: NDArray[np.int64]
    late: NDArray[np.int64]
    step: NDArray[np.int64]
    sampled: NDArray[np.bool_]

    @classmethod
    def of(cls, run: PatchRun, skew: NDArray[np.int64], *, spread: bool) -> Self:
        rows, columns = run.lo.shape
        error = run.error if spread else 0
        middle = run.t + skew + run.dt * np.arange(rows)[:, np.newaxis]
        strides = np.frombuffer(run.strides or bytes(columns), np.uint8).astype(np.int64)
        step = np.broadcast_to(run.dt << strides, middle.shape)
        sampled = Sampling(rows, columns, run.first_row, run.strides).mask
        return cls(middle - error, middle, middle + error, step, sampled)


def _following(times: NDArray[np.int64]) -> NDArray[np.int64]:
    """The least time of all later rows, for each cell."""
    least = np.minimum.accumulate(times[::-1], axis=0)[::-1]
    return np.concatenate([least[1:], np.full_like(times[:1], _NEVER)])


def _positions(patches: Iterable[Patch]) -> Floats:
    """In m, shape ``(n, d)``; patches without z lie at z = 0 if others have one."""
    axes = max(len(patch.positions) for patch in patches)
    parts = [
        np.array([*patch.positions, *[(0,) * len(patch.taxels)] * (axes - len(patch.positions))])
        for patch in patches
    ]
    return np.concatenate(parts, axis=1).T / _MICROMETRE
