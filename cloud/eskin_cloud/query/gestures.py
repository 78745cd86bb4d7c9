"""Gestures on a skin that one node samples, from its stored samples.

An instant is a row of the node's sampling grid: all patches in Pa share one. A taxel counts as
pressed there at the instant of its own sample, and the instant's time is enclosed with those of
all taxels. What is not stored, or was not sampled, is unknown: such a taxel is possibly pressed.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from eskin.errors import QueryError
from eskin.gestures import GestureStream
from eskin.wire.frames import Sampling
from eskin.wire.timestamp import SECOND
from eskin_cloud.query.contacts import UNIT, ContactSkin
from eskin_cloud.store.descriptions import find_layout, find_shares
from eskin_cloud.store.read.lookup import UnknownChannelError, find_node
from eskin_cloud.store.read.patch_runs import find_last, first_start, read_described_runs
from eskin_cloud.store.read.window import Window, clip

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.gestures import Gesture
    from eskin.interval import Floats
    from eskin_cloud.store.patch_run import PatchRun

    Integers = NDArray[np.int64]

MOST_SAMPLES: Final = 20_000_000
"""Most samples of an answer: taxels times instants."""
MOST_INSTANTS: Final = 50_000
"""Most instants of an answer."""
LOST: Final = 3
"""Unknown instants in the place of a gap, however many were lost there: one beside each end, and
one that is beside none."""
_AT_ONCE: Final = 2_000_000
"""Samples that are held at once, about."""
_FIRST_SPAN: Final = SECOND
_LONGEST_SPAN: Final = 10 * SECOND
_SEE: Final = "see docs/gestures.md#of-a-stored-skin"
_EARLIEST, _LATEST = np.iinfo(np.int64).min, np.iinfo(np.int64).max


class GestureSkin:
    """A skin that one node samples, whose gestures are sought.

    Args:
        connection: In a read transaction.
        node: The node; its latest layout counts.

    Attributes:
        last: Time of its last sample, UTC ns; ``None`` if there is none.

    Raises:
        UnknownChannelError: The node is unknown, or no taxel of its skin has contacts.
        QueryError: Several nodes sample its skin.
        UnknownDescriptionError: A layout is damaged in the store.
        DamagedRowError: The node's row is damaged.
    """

    def __init__(self, connection: Connection, node: str) -> None:
        name = find_node(connection, node)["layout"]
        described = None if name is None else find_layout(connection, node, name)
        skin = None if described is None else ContactSkin.of(described)
        if described is None or skin is None:
            raise UnknownChannelError(
                "node",
                f"{node} has no patch in {UNIT} with a threshold, areas and positions, "
                f"so there are no gestures on its skin; {_SEE}",
            )
        shares = find_shares(connection, node, described)
        if len(shares) > 1:
            raise QueryError(
                "node",
                f"{node} shares its skin with {len(shares) - 1} other nodes, whose samples are of "
                f"other instants; gestures are found on skins that one node samples, {_SEE}",
            )
        self._connection, self._node = connection, shares[0].node
        self._described, self._skin = described, skin
        self._skew = max(
            (skew for number in skin.places for skew in described.patches[number].skew), default=0
        )
        self.last = find_last(connection, self._node)

    def find(self, window: Window) -> list[Gesture]:
        """The gestures of a window, whose record begins and ends there.

        Raises:
            QueryError: It holds too many samples, or the patches are sampled on several grids.
        """
        self._require_few(window)
        record = _Record(self._node, self._skin, self._skew)
        for rows, end in self._stretches(window):
            record.feed(rows, end)
        return record.finish()

    def _require_few(self, window: Window) -> None:
        taxels = len(self._skin.taxels)
        most, count = min(MOST_INSTANTS, MOST_SAMPLES // taxels), 0
        for rows, _ in self._stretches(window):
            counts: Counter[int] = Counter()
            for each in rows:
                counts[each.patch] += len(each.lo)
            count += max(counts.values())
            if count > most:
                longest = most * min(each.dt for each in rows) // SECOND
                raise QueryError(
                    "start",
                    f"the window has over {most} instants of {taxels} taxels; choose a shorter "
                    f"one, of {longest} s at these rates",
                )

    def _stretches(self, window: Window) -> Iterator[tuple[list[_Rows], int]]:
        """All rows of a window, stretch by stretch, each as long as fits the memory.

        A frame comes with the first stretch in which it has samples. All rows that are stated to be
        before the end of a stretch have come with it, except some at which nothing was sampled.
        """
        numbers, taxels = list(self._skin.places), len(self._skin.taxels)
        at, span = window.start, _FIRST_SPAN
        known: set[tuple[int, int, int]] = set()
        while at < window.end:
            at, begin = min(at + span, window.end), at
            # Frames are found by the times of their samples, which are later than their rows.
            asked = Window(begin, at + self._skew)
            found = read_described_runs(
                self._connection, self._node, self._described, numbers, asked
            )
            runs = {
                (number, run.boot, run.sequence): run
                for number, of_patch in found.items()
                for run in of_patch
            }
            rows = [
                each
                for key, run in runs.items()
                if key not in known and len((each := _Rows.of(key[0], run, window)).lo)
            ]
            known = set(runs)
            if rows:
                yield rows, at
                dt = min(each.dt for each in rows)
                span = min(dt * max(1, _AT_ONCE // taxels), max(_LONGEST_SPAN, 16 * dt))
            elif not runs:
                at = self._next(Window(at, window.end))

    def _next(self, window: Window) -> int:
        """When the next rows begin in a window."""
        starts = (
            first_start(
                self._connection, self._node, self._described.patches[number].patch_id, window
            )
            for number in self._skin.places
        )
        found = min((start for start in starts if start is not None), default=window.end)
        return max(window.start, found - self._skew)


class _Rows(NamedTuple):
    """Rows of a patch from one frame, whose stated times lie in a window.

    Attributes:
        patch: Its number in the layout.
        boot: The node's start.
        ticks: The node's clock at the first row, ns.
        t: Middle of the first row's time, UTC ns.
        error: Greatest distance of a row's time from its middle, ns.
        dt: Period, ns.
        lo: Lower bounds, ``-inf`` where unknown, shape ``(rows, columns)``.
        hi: Upper bounds.
        sampled: Whether a column was sampled in a row.
    """

    patch: int
    boot: int
    ticks: int
    t: int
    error: int
    dt: int
    lo: Floats
    hi: Floats
    sampled: NDArray[np.bool_]

    @classmethod
    def of(cls, number: int, run: PatchRun, window: Window) -> Self:
        rows, columns = run.lo.shape
        first, last = clip(run.t, run.dt, rows, window)
        mask = Sampling(rows, columns, run.first_row, run.strides).mask
        whole = cls(
            number, run.boot, run.ticks, run.t, run.error, run.dt, run.lo, run.hi,
            np.any(mask, axis=1),
        )  # fmt: skip
        return whole.part(first, max(first, last + 1))

    def count_before(self, bound: tuple[int, int]) -> int:
        """How many rows are before a start of the node and its clock."""
        if self.boot != bound[0]:
            return len(self.lo) if self.boot < bound[0] else 0
        return min(max(0, -((self.ticks - bound[1]) // self.dt)), len(self.lo))

    @property
    def last(self) -> tuple[int, int]:
        """Start of the node, and its clock at the last row."""
        return self.boot, self.ticks + self.dt * (len(self.lo) - 1)

    def part(self, begin: int, end: int) -> Self:
        """Some of the rows, without the last one of them."""
        own = slice(begin, end)
        return self._replace(
            ticks=self.ticks + begin * self.dt,
            t=self.t + begin * self.dt,
            lo=self.lo[own],
            hi=self.hi[own],
            sampled=self.sampled[own],
        )


class _Record:
    """Recognises gestures in rows that arrive stretch by stretch.

    Args:
        node: The node.
        skin: Its skin.
        skew: How much later than their row columns are sampled, at most, ns.
    """

    def __init__(self, node: str, skin: ContactSkin, skew: int) -> None:
        self._node, self._skin, self._skew = node, skin, skew
        self._stream = GestureStream(skin.skin, skin.least)
        self._held: list[_Rows] = []
        self._last: _Last | None = None
        self._torn = False
        self._found: list[Gesture] = []

    def feed(self, rows: Sequence[_Rows], end: int) -> None:
        """Take the rows of the next stretch.

        Args:
            rows: Of each patch.
            end: All rows before this time have come, UTC ns.

        Raises:
            QueryError: They are of several grids.
        """
        every = [*self._held, *rows]
        # Other patches of the last instant, and of those after the stretch, may still come.
        bound = min([max(each.last for each in every), *(
            (each.boot, each.ticks + late * each.dt)
            for each in every
            if (late := max(0, -((each.t - end) // each.dt))) < len(each.lo)
        )])  # fmt: skip
        early = [each.count_before(bound) for each in every]
        pairs = [(each, count) for each, count in zip(every, early, strict=True)]
        self._held = [
            each.part(count, len(each.lo)) for each, count in pairs if count < len(each.lo)
        ]
        self._take([each.part(0, count) for each, count in pairs if count])

    def finish(self) -> list[Gesture]:
        """All gestures."""
        self._take(self._held)
        return [*self._found, *self._stream.finish()]

    def _take(self, rows: Sequence[_Rows]) -> None:
        found = _Instants.of(rows, self._last, self._node)
        self._torn |= found.torn
        count, size = len(found.ticks), len(self._skin.taxels)
        if not count:
            return
        found.gap[0] |= self._torn
        self._torn = False
        seen = np.zeros((count, len(self._skin.places)), np.bool_)
        sampled = np.zeros(count, np.bool_)
        # Lost instants come before the one that they precede.
        places = np.arange(count) + LOST * np.cumsum(found.gap)
        lo = np.full((count + LOST * int(found.gap.sum()), size), -np.inf)
        hi, times = np.full_like(lo, np.inf), np.empty((len(lo), 2), np.int64)
        numbers = list(self._skin.places)
        for each, own in zip(rows, found.of_rows, strict=True):
            kept, at = own >= 0, places[own[own >= 0]]
            taxels = self._skin.places[each.patch]
            lo[at, taxels], hi[at, taxels] = each.lo[kept], each.hi[kept]
            seen[own[kept], numbers.index(each.patch)] = True
            sampled[own[kept]] |= each.sampled[kept]
        # The node's clock states the order: no instant is earlier than one before it.
        bounds = np.stack([found.early, found.late + self._skew], axis=1)
        before = (_EARLIEST, _EARLIEST) if self._last is None else self._last.instant
        bounds = np.maximum.accumulate(np.concatenate([[before], bounds]))
        times[places] = bounds[1:]
        for k in np.flatnonzero(found.gap).tolist():
            times[places[k] - LOST : places[k]] = bounds[k, 0], bounds[k + 1, 1]
        boot, ticks, dt = (int(each[-1]) for each in (found.boot, found.ticks, found.dt))
        self._last = _Last(boot, ticks, dt, (int(bounds[-1, 0]), int(bounds[-1, 1])))
        # A row at which no taxel was sampled is no instant.
        used = np.ones(len(lo), np.bool_)
        used[places] = sampled | ~seen.all(axis=1)
        lo, hi = self._skin.levelled(lo[used]), self._skin.levelled(hi[used])
        self._found += self._stream.feed(lo, hi, times[used])


class _Last(NamedTuple):
    """The last instant that was taken: as in `_Instants`, and an enclosure of its time."""

    boot: int
    ticks: int
    dt: int
    instant: tuple[int, int]


class _Instants(NamedTuple):
    """Instants of a stretch, in order.

    Attributes:
        boot: The node's start, shape ``(m,)``.
        ticks: The node's clock, ns.
        dt: Period, ns.
        early: Earliest instant of the row, UTC ns; a column is later by its skew.
        late: Latest one.
        gap: Whether instants may have been lost before it.
        of_rows: For each of some rows, the number of its instant; -1 if it is not after the last
            instant of the stretch before.
        torn: Whether samples of such rows are left out.
    """

    boot: Integers
    ticks: Integers
    dt: Integers
    early: Integers
    late: Integers
    gap: NDArray[np.bool_]
    of_rows: Sequence[Integers]
    torn: bool

    @classmethod
    def of(cls, rows: Sequence[_Rows], last: _Last | None, node: str) -> Self:
        """The instants of some rows.

        Raises:
            QueryError: The rows are of several grids.
        """
        sizes = [len(each.lo) for each in rows]
        steps = [each.dt * np.arange(size) for each, size in zip(rows, sizes, strict=True)]
        nothing = np.empty(0, np.int64)
        ticks = np.concatenate(
            [nothing, *(each.ticks + step for each, step in zip(rows, steps, strict=True))]
        )
        middle = np.concatenate(
            [nothing, *(each.t + step for each, step in zip(rows, steps, strict=True))]
        )
        heads = np.array([each[1:6] for each in rows], np.int64).reshape(-1, 5)
        boot, _, _, error, dt = np.repeat(heads, sizes, axis=0).T
        fresh = np.ones(len(ticks), np.bool_)
        if last is not None:
            fresh = (boot > last.boot) | ((boot == last.boot) & (ticks > last.ticks))
        keys, places = np.unique(
            np.stack([boot, ticks], axis=1)[fresh], axis=0, return_inverse=True
        )
        count = len(keys)
        number = np.full(len(ticks), -1)
        number[fresh] = places.reshape(-1)
        shortest, longest = np.full(count, _LATEST), np.zeros(count, np.int64)
        early, late = np.full(count, _LATEST), np.full(count, _EARLIEST)
        for least, greatest, low, high in (
            (shortest, longest, dt, dt),
            (early, late, middle - error, middle + error),
        ):
            np.minimum.at(least, number[fresh], low[fresh])
            np.maximum.at(greatest, number[fresh], high[fresh])
        of_rows = np.split(number, np.cumsum(sizes)[:-1]) if sizes else []
        if np.any(shortest < longest) or any(_is_mixed(own[own >= 0]) for own in of_rows):
            raise QueryError(
                "node",
                f"{node} samples its patches in {UNIT} at different instants; gestures are found "
                f"on skins with one sampling grid, {_SEE}",
            )
        first = (-1, 0, 0) if last is None else last[:3]
        before = np.concatenate([[first], np.stack([*keys.T, shortest], axis=1)])[:-1]
        step = keys[:, 1] - before[:, 1]
        gap = (keys[:, 0] != before[:, 0]) | (shortest != before[:, 2])
        gap |= abs(step - shortest) > shortest // 2
        if count and last is None:
            gap[0] = False
        sampled = np.concatenate([fresh[:0], *(each.sampled for each in rows)])
        torn = bool(np.any(sampled & ~fresh))
        return cls(keys[:, 0], keys[:, 1], shortest, early, late, gap, of_rows, torn)


def _is_mixed(numbers: Integers) -> bool:
    """Whether other instants are between rows of one patch that follow each other."""
    return bool(np.any(np.diff(numbers) != 1))
