"""Contacts of a skin whose samples arrive in pieces."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.contacts.contacts import core_type, pressures_of, require_threshold, search
from eskin.contacts.links import link_contacts
from eskin.contacts.nearest import choose_nearest
from eskin.contacts.tracks import AFTER_ALL, BEFORE_ALL, INSTANT, TRACK, ContactTracks
from eskin.errors import ContactError
from eskin.interval import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from eskin.contacts.components import Indices
    from eskin.contacts.contacts import Contacts
    from eskin.contacts.links import Links
    from eskin.contacts.skin import Skin
    from eskin.interval import Floats

_NO_INDICES: Final = np.empty(0, np.int64)


class ContactStream:
    """Follows the contacts of a skin whose samples arrive in pieces, in bounded memory.

    Labels are given by this rule. Of the certain links to an instant those with the most shared
    taxels come first, then those of lower labels, then those to lower cores; each hands the label
    of its earlier core on, if both cores are free. Then each core that has none, in order, takes
    the label whose last core is nearest, of those that may go on in its region, and of equally near
    ones the lowest; and a new one, the next number, where there is none. Labels count from 0.

    A label without a core waits as long as its contact may go on. If more labels wait than the skin
    has taxels, those that lost their cores first are given up: their ends have no upper bound.

    Args:
        skin: The n taxels.
        threshold: Pressure in Pa above which a taxel is pressed, positive and finite.

    Raises:
        ContactError: The threshold is not positive and finite.
    """

    def __init__(self, skin: Skin, threshold: float) -> None:
        self._skin = skin
        self._threshold = require_threshold(threshold)
        self._sample = 0
        self._labels = 0
        self._time = (BEFORE_ALL, BEFORE_ALL)
        self._rest()

    @property
    def labels(self) -> list[int]:
        """The labels of the last sample's cores."""
        return [track.id for track in self._holders]

    def feed(self, lo: ArrayLike, hi: ArrayLike, times: ArrayLike) -> ContactTracks:
        """Take the next samples, in order.

        Args:
            lo: Lower bounds of the pressures in Pa, shape ``(samples, n)``; ``-inf`` or NaN where
                unknown.
            hi: Upper bounds in Pa; ``inf`` or NaN where unknown.
            times: Enclosure of each sample's instant, shape ``(samples, 2)``, whole ns (UTC): its
                earliest and its latest.

        Returns:
            The tracks that end here, and the cores of these samples with their labels. Samples are
            counted since the start of the stream.

        Raises:
            ContactError: Times are no enclosures, or run backwards. The stream stays as it was.
            IntervalError: Bounds are no intervals, or shapes do not fit. The stream stays as it
                was.
        """
        enclosures = require_times(times, self._time)
        lows, highs = pressures_of(lo, hi, (len(enclosures), len(self._skin)))
        steps = [
            self._step(low, high, instant)
            for low, high, instant in zip(lows, highs, enclosures, strict=True)
        ]
        ended, cores, instants = zip(*steps, strict=True) if steps else ((), (), ())
        return _collected(self._skin, ended, cores, instants)

    def follow(self, lo: Floats, hi: Floats, instant: tuple[int, int]) -> Contacts:
        """Take one sample, checked as `feed` does, where only its contacts and labels are needed.

        Args:
            lo: Lower bounds of the pressures in Pa, shape ``(n,)``.
            hi: Upper bounds in Pa.
            instant: Enclosure of its instant, ns.
        """
        found = search(lo, hi, self._skin, self._threshold)
        self._take(found, instant)
        return found

    def finish(self) -> ContactTracks:
        """Say that the record ends: what follows, if anything, is linked to nothing.

        Returns:
            The tracks that were not ended, whose ends have no upper bound.
        """
        left = [*self._holders, *self._waiting]
        self._rest()
        rows = [track.row(AFTER_ALL) for track in sorted(left, key=lambda track: track.id)]
        return _collected(self._skin, [rows], [], [])

    def _rest(self) -> None:
        """Forget the last instant."""
        self._found: Contacts | None = None
        self._holders: list[_Track] = []
        self._waiting: list[_Track] = []
        self._possible_since = self._certain_since = _NO_INDICES

    def _step(
        self, lo: Floats, hi: Floats, instant: tuple[int, int]
    ) -> tuple[list[_Row], NDArray[np.void], tuple[Any, ...]]:
        """Take one sample; gives rows of tracks, of cores, and one of instants."""
        found = search(lo, hi, self._skin, self._threshold)
        ended = self._take(found, instant)
        core_rows = np.empty(len(found), _sample_type(self._skin))
        core_rows["sample"] = self._sample - 1
        core_rows["track"] = [track.id for track in self._holders]
        for name in found.table.dtype.names or ():
            core_rows[name] = found.table[name]
        regions = found.regions
        row = (
            self._sample - 1, len(found), len(regions.possible), *regions.total,
            bool(regions.table["exact"].all()),
        )  # fmt: skip
        return ended, core_rows, row

    def _take(self, found: Contacts, instant: tuple[int, int]) -> list[_Row]:
        """Go on to the contacts of the next sample; gives the rows of tracks that ended."""
        links = None if self._found is None else link_contacts(self._found, found)
        self._bound_begins(found, links, instant)
        ended = self._hand_on(found, links, instant)
        self._found, self._time = found, instant
        self._sample += 1
        return ended

    def _bound_begins(self, found: Contacts, links: Links | None, instant: tuple[int, int]) -> None:
        """Earliest begin of any contact in each region, and latest of the contact of each core."""
        earliest = BEFORE_ALL if links is None else self._time[0]
        possible = np.full(len(found.regions), earliest)
        certain = np.full(len(found), instant[1])
        if links is not None:
            for since, before, pairs in (
                (possible, self._possible_since, links.regions),
                (certain, self._certain_since, links.cores),
            ):
                np.minimum.at(since, pairs[:, 1], before[pairs[:, 0]])
        self._possible_since, self._certain_since = possible, certain

    def _hand_on(
        self, found: Contacts, links: Links | None, instant: tuple[int, int]
    ) -> list[_Row]:
        """Give each core a track; gives the rows of tracks that ended."""
        holders: list[_Track | None] = [None] * len(found)
        waiting = self._waiting
        if links is not None:
            self._follow_links(links, holders)
            kept = set(holders)
            lost = [track for track in self._holders if track not in kept]
            waiting = sorted([*waiting, *lost], key=lambda track: track.id)
            _advance(waiting, links, instant[0])
        ended = [track.row(instant[1]) for track in waiting if not track.regions]
        waiting = [track for track in waiting if track.regions]
        places = _mean_places(found, self._skin)
        region_of_core = found.table["region"].tolist()
        _take_nearest(holders, waiting, region_of_core, places)
        for core, region in enumerate(region_of_core):
            track = holders[core]
            if track is None:
                track = holders[core] = self._new_track(core, region)
            track.hold(core, region, self._sample, instant[0], places[core])
        self._holders = [track for track in holders if track is not None]
        held = set(self._holders)
        self._waiting = [track for track in waiting if track not in held]
        return ended + self._give_up()

    def _follow_links(self, links: Links, holders: list[_Track | None]) -> None:
        """Hand tracks on along certain links."""
        earlier, later, shared = links.cores.T
        labels = np.array([track.id for track in self._holders], np.int64)[earlier]
        taken = set()
        for k in np.lexsort((later, labels, -shared)).tolist():
            track, core = self._holders[earlier[k]], int(later[k])
            if holders[core] is None and track not in taken:
                holders[core] = track
                taken.add(track)

    def _new_track(self, core: int, region: int) -> _Track:
        begin = int(self._possible_since[region]), int(self._certain_since[core])
        track = _Track(self._labels, begin, self._sample)
        self._labels += 1
        return track

    def _give_up(self) -> list[_Row]:
        """Rows of the tracks that wait beyond what memory is bounded to."""
        surplus = len(self._waiting) - len(self._skin)
        if surplus <= 0:
            return []
        oldest = sorted(self._waiting, key=lambda track: (track.last, track.id))[:surplus]
        gone = set(oldest)
        self._waiting = [track for track in self._waiting if track not in gone]
        return [track.row(AFTER_ALL) for track in oldest]


def track_contacts(
    lo: ArrayLike, hi: ArrayLike, times: ArrayLike, skin: Skin, threshold: float
) -> ContactTracks:
    """Contacts over time, of a whole record.

    Beside what it returns, this needs the memory of a few samples; a record that does not fit into
    memory goes piece by piece through a `ContactStream`.

    Args:
        lo: Lower bounds of the pressures in Pa, shape ``(samples, n)``; ``-inf`` or NaN where
            unknown.
        hi: Upper bounds in Pa; ``inf`` or NaN where unknown.
        times: Enclosure of each sample's instant, shape ``(samples, 2)``, whole ns (UTC): its
            earliest and its latest.
        skin: The n taxels.
        threshold: Pressure in Pa above which a taxel is pressed, positive and finite.

    Returns:
        All tracks by label, and the cores of all samples.

    Raises:
        ContactError: The threshold is not positive and finite, times are no enclosures, or they run
            backwards.
        IntervalError: Bounds are no intervals, or shapes do not fit.
    """
    stream = ContactStream(skin, threshold)
    found = stream.feed(lo, hi, times)
    table = np.concatenate([found.table, stream.finish().table])
    return ContactTracks(table[np.argsort(table["id"])], found.cores, found.instants)


_Row = tuple[int, int, int, int, int, int, int, int]


@dataclass(slots=True, eq=False)
class _Track:
    """A track that may go on.

    Attributes:
        id: Its label.
        begin: Enclosure of its begin.
        first: First sample at which it has a core.
        last: Last sample at which it has a core.
        verdict: Whether all instants are of one chain.
        certain: Earliest time of the last instant at which its contact is certain.
        cores: Cores that its contact certainly goes on in.
        regions: Regions that its contact may go on in.
        place: Mean position of its last core's taxels.
    """

    id: int
    begin: tuple[int, int]
    first: int
    last: int = -1
    verdict: Verdict = Verdict.CERTAIN
    certain: int = BEFORE_ALL
    cores: frozenset[int] = frozenset()
    regions: frozenset[int] = frozenset()
    place: Any = None

    def hold(self, core: int, region: int, sample: int, earliest: int, place: Floats) -> None:
        """Hold a core at an instant."""
        self.last, self.certain, self.place = sample, earliest, place
        self.cores, self.regions = frozenset((core,)), frozenset((region,))

    def row(self, end: int) -> _Row:
        """Its row in a table, with the latest time of its end."""
        return (self.id, self.verdict, self.first, self.last, *self.begin, self.certain, end)


def _advance(waiting: Sequence[_Track], links: Links, earliest: int) -> None:
    """Find out where the contacts of tracks without a core go on."""
    if not waiting:
        return
    cores, regions = _successors(links.cores), _successors(links.regions)
    for track in waiting:
        track.cores = cores(track.cores)
        track.regions = regions(track.regions)
        if track.cores:
            track.certain = earliest


def _successors(pairs: Indices) -> Callable[[frozenset[int]], frozenset[int]]:
    """The numbers that some numbers are linked to; many tracks ask for the same ones."""
    after: dict[int, list[int]] = {}
    for one, two in pairs[:, :2].tolist():
        after.setdefault(one, []).append(two)

    @functools.cache
    def follow(numbers: frozenset[int]) -> frozenset[int]:
        return frozenset(two for one in numbers for two in after.get(one, ()))

    return follow


def _take_nearest(
    holders: list[_Track | None],
    waiting: Sequence[_Track],
    region_of_core: Sequence[int],
    places: Floats,
) -> None:
    """Give each core without a track the nearest one that may go on in its region."""
    left = [core for core, track in enumerate(holders) if track is None]
    if not left or not waiting:
        return
    around: dict[int, list[int]] = {region_of_core[core]: [] for core in left}
    for number, track in enumerate(waiting):
        for region in around.keys() & track.regions:
            around[region].append(number)
    numbers = {region: number for number, region in enumerate(around)}
    chosen = np.empty(len(left), np.int64)
    choose_nearest(
        places[left],
        np.array([numbers[region_of_core[core]] for core in left]),
        np.cumsum([0, *map(len, around.values())]),
        np.array([number for near in around.values() for number in near], np.int64),
        np.array([track.place for track in waiting]),
        chosen,
    )
    for core, number in zip(left, chosen.tolist(), strict=True):
        if number >= 0:
            track = holders[core] = waiting[number]
            if core not in track.cores:
                track.verdict = Verdict.POSSIBLE


def _mean_places(found: Contacts, skin: Skin) -> Floats:
    """Mean position of each core's taxels, to nearest: only labels depend on it."""
    inside = found.core_of >= 0
    cores, positions = found.core_of[inside], skin.positions[inside]
    sums = [np.bincount(cores, column, minlength=len(found)) for column in positions.T]
    return np.stack(sums, axis=1) / np.bincount(cores, minlength=len(found))[:, None]


def require_times(times: ArrayLike, before: tuple[int, int]) -> list[tuple[int, int]]:
    """Instants of samples, of which each bound is at least that of the sample before.

    Raises:
        ContactError: They are not.
    """
    array = np.asarray(times)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ContactError(
            f"times have shape {array.shape}; give the earliest and the latest instant of each "
            "sample, shape (samples, 2)"
        )
    if array.size and (array.dtype.kind not in "iu" or int(array.max()) > AFTER_ALL):
        raise ContactError(f"times have dtype {array.dtype}; give whole ns as int64")
    enclosures = [(earliest, latest) for earliest, latest in array.tolist()]
    for sample, (instant, last) in enumerate(zip(enclosures, [before, *enclosures], strict=False)):
        if instant[0] > instant[1]:
            raise ContactError(
                f"times of sample {sample} are reversed: {instant}; give the earliest first"
            )
        if instant[0] < last[0] or instant[1] < last[1]:
            raise ContactError(
                f"times of sample {sample} run backwards: {instant} after {last}; give samples in "
                "order, each bound at least that of the sample before"
            )
    return enclosures


def _sample_type(skin: Skin) -> np.dtype[np.void]:
    """A row of `ContactTracks.cores`."""
    return np.dtype([("sample", np.int64), ("track", np.int64), *core_type(skin).descr])


def _collected(
    skin: Skin,
    ended: Iterable[list[_Row]],
    cores: Sequence[NDArray[np.void]],
    instants: Sequence[tuple[Any, ...]],
) -> ContactTracks:
    return ContactTracks(
        np.array([row for rows in ended for row in rows], TRACK),
        np.concatenate([np.empty(0, _sample_type(skin)), *cores]),
        np.array(list(instants), INSTANT),
    )
