"""The contacts of a skin at one instant, from frames."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.contacts import Skin, find_contacts
from eskin.wire.frames import Sampling
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin_cloud.store.read.patch_runs import read_runs
from eskin_cloud.store.read.window import Window, before

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.contacts import Contacts
    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout, Patch
    from eskin_cloud.store.patch_run import PatchRun

UNIT: Final = "Pa"
LONGEST_HOLD: Final = 2_000_000_000
"""An earlier sample counts for an instant no longer than this, in ns, whatever its period is."""
_MICROMETRE: Final = 1e6


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
        self, connection: Connection, node: str, described: DescribedLayout, t: int
    ) -> Pressures:
        """What is known of each taxel at an instant: a sample holds for its period at most.

        Args:
            connection: In a read transaction.
            node: The node.
            described: The layout of this skin.
            t: UTC ns.
        """
        found = Pressures(len(self.taxels), t)
        window = Window(before(t, LONGEST_HOLD), t + 1)
        for number, place in self.places.items():
            patch = described.patches[number]
            for run in read_runs(connection, node, patch.patch_id, window):
                if run.patch == described.layout.patches[number]:
                    _put_held(found, place.start, run, patch, t)
        return found

    def find(self, pressures: Pressures) -> Contacts:
        """The contacts at one instant."""
        least = float(self.threshold.min())
        # Where thresholds differ, bounds between the least and a taxel's own become the least, so
        # that they lie above the one exactly where they lay above the other.
        lo, hi = (
            np.where((bound > least) & (bound <= self.threshold), least, bound)
            for bound in (pressures.lo, pressures.hi)
        )
        return find_contacts(lo, hi, self.skin, least)


def last_rows(mask: NDArray[np.bool_], until: NDArray[np.int64]) -> NDArray[np.int64]:
    """The row of each column's last sample; -1 where it has none.

    Args:
        mask: Which cells hold a sample, shape ``(rows, columns)``.
        until: The last row that counts, for each column; -1 for none.
    """
    rows = np.arange(len(mask))[:, np.newaxis]
    return np.asarray(np.where(mask & (rows <= until), rows, -1).max(axis=0), np.int64)


def _put_held(found: Pressures, begin: int, run: PatchRun, patch: Patch, t: int) -> None:
    """State the columns of a run whose sample is the latest one before an instant."""
    rows, columns = run.lo.shape
    skew = np.array(patch.skew or (0,) * columns, np.int64)
    until = np.clip((t - run.t - skew) // run.dt, -1, rows - 1)
    sampling = Sampling(rows, columns, run.first_row, run.strides)
    last = last_rows(sampling.mask, until)
    steps = run.dt << np.frombuffer(run.strides or bytes(columns), np.uint8).astype(np.int64)
    # Half a period late is no gap yet, as everywhere (`store.read.block_index.longest_step`).
    held = t - (run.t + skew + last * run.dt) <= steps + steps // 2
    chosen = np.flatnonzero((last >= 0) & held)
    found.put(begin + chosen, run.lo[last[chosen], chosen], run.hi[last[chosen], chosen], run.error)


def _positions(patches: Iterable[Patch]) -> Floats:
    """In m, shape ``(n, d)``; patches without z lie at z = 0 if others have one."""
    axes = max(len(patch.positions) for patch in patches)
    parts = [
        np.array([*patch.positions, *[(0,) * len(patch.taxels)] * (axes - len(patch.positions))])
        for patch in patches
    ]
    return np.concatenate(parts, axis=1).T / _MICROMETRE
