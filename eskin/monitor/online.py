"""Evaluate a formula while samples arrive, in bounded memory."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.errors import IntervalError, MonitorError
from eskin.interval import Interval
from eskin.monitor.atoms import candidates, judge
from eskin.monitor.checks import Columns, channel_horizons, check, comparison_of, deviation_units
from eskin.monitor.evaluation import Evaluation
from eskin.monitor.formula import Atom
from eskin.monitor.online_kernels import CERTAIN, FULL, NO_UNTIL, POSSIBLE, Side, accept, settle
from eskin.monitor.prediction import deviation
from eskin.monitor.program import instructions, threshold
from eskin.monitor.runs import END
from eskin.monitor.shared import SharedError
from eskin.monitor.signal import MAX_INSTANT, Signal, held_samples
from eskin.monitor.verdicts import Piece, Verdicts, piece

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from eskin.monitor.formula import Formula
    from eskin.monitor.prediction import Prediction

_FIRST_ROOM: Final = 64
_NO_GAPS: Final = np.empty(0, bool)
_FIRST_ARENA: Final = 1024


class _Arena(threading.local):
    """Room for the lists of one evaluation, which all monitors of a thread share."""

    def __init__(self) -> None:
        self.lists = np.empty((2, _FIRST_ARENA), np.int64)
        self.pieces = np.empty(_FIRST_ARENA, np.int64), np.empty(_FIRST_ARENA, np.int8)

    def grow(self) -> None:
        """Double the room; what was written stays."""
        self.lists = np.concatenate((self.lists, self.lists), axis=1)
        size = self.lists.shape[1]
        self.pieces = np.empty(size, np.int64), np.empty(size, np.int8)


_arena: Final = _Arena()


class Monitor:
    """A formula over channels whose samples arrive.

    Push samples, one by one or a stretch at once, and now and then `take` what is decided for good.
    `verdicts` is the view at this instant, also of what is still open. Samples that no open verdict
    needs are dropped.

    Args:
        formula: All its windows must be bounded.
        units: UCUM code of each channel.
        coverage: Of channels whose intervals do not always enclose the truth.
        shared: Of channels whose samples share errors; epochs come with the samples.
        capacity: How many samples a channel may keep.

    Attributes:
        formula: What is evaluated.

    Raises:
        MonitorError: The formula does not fit the channels, or a window is unbounded.
    """

    def __init__(
        self,
        formula: Formula,
        units: Mapping[str, str],
        *,
        coverage: Mapping[str, float] | None = None,
        shared: Mapping[str, SharedError] | None = None,
        capacity: int = 2**16,
    ) -> None:
        check(formula, units, bounded=True)
        self.formula = formula
        units = {**units, **deviation_units(formula, units)}
        self._names = sorted(formula.channels)
        deviations = formula.deviations
        self._readers: dict[str, list[tuple[str, Prediction | None]]] = {}
        for name in self._names:
            node = deviations.get(name)
            pushed, prediction = (name, None) if node is None else (node.source, node.prediction)
            self._readers.setdefault(pushed, []).append((name, prediction))
        self._place = {name: k for k, name in enumerate(self._names)}
        self._units = {name: units[name] for name in self._names}
        self._coverage = {name: (coverage or {}).get(name, 1.0) for name in self._names}
        self._shared = dict(shared or {})
        self._capacity = capacity
        horizons = channel_horizons(formula)
        self._past = np.array([horizons[name].past or 0 for name in self._names], np.int64)
        self._program = _Program.of(formula, self._place, self._units)
        self._spans = np.array([[0, 0, NO_UNTIL] for _ in self._names], np.int64).reshape(-1, 3)
        self._columns = _Columns.of(len(self._names), len(self._program.atoms), _FIRST_ROOM)
        self._settled = -END  # the first tick whose verdict was not taken
        self._view: Verdicts | None = None

    def push(
        self,
        channel: str,
        earliest: int,
        latest: int,
        lo: float,
        hi: float,
        *,
        period: int,
        epoch: int = 1,
    ) -> None:
        """Add the next sample of a channel, with its instant's enclosure in ns.

        A sample that is unbounded on both sides is a missing one: the sample before it is held for
        one period.

        Raises:
            MonitorError: The formula has no such channel, the sample is before the last one, or the
                channel keeps too many, as another channel is silent.
        """
        self.extend(channel, [earliest], [latest], [lo], [hi], period, epoch=epoch)

    def extend(
        self,
        channel: str,
        earliest: ArrayLike,
        latest: ArrayLike,
        lo: ArrayLike,
        hi: ArrayLike,
        period: ArrayLike,
        gap: ArrayLike | None = None,
        epoch: ArrayLike = 1,
    ) -> None:
        """Add the next samples of a channel at once; arguments as of `Signal`.

        Epochs count where the channel shares errors.

        Raises:
            MonitorError: As `push`; the samples before the one in error are added, but none where
                a deviation is read and bounds are no intervals.
        """
        columns = []
        for name, prediction in self._read_by(channel):
            bounds = lo, hi
            if prediction is not None:
                try:
                    signal = Signal(earliest, latest, lo, hi, period, gap, unit=self._units[name])
                except IntervalError as error:
                    raise MonitorError(f"samples of {channel}: {error}", value=channel) from error
                outside = deviation(signal, prediction)
                bounds = outside.lo, outside.hi
            columns.append((name, bounds))
        # Each takes the same samples before the one in error, so that all stay alike.
        errors: list[MonitorError] = []
        for name, bounds in columns:
            try:
                self._extend(name, earliest, latest, *bounds, period, gap, epoch)
            except MonitorError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def _extend(
        self,
        channel: str,
        earliest: ArrayLike,
        latest: ArrayLike,
        lo: ArrayLike,
        hi: ArrayLike,
        period: ArrayLike,
        gap: ArrayLike | None,
        epoch: ArrayLike,
    ) -> None:
        at = self._place[channel]
        instants = np.asarray(earliest), np.asarray(latest)
        bounds = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
        periods = np.asarray(period, np.int64).reshape(-1)
        gaps = _NO_GAPS if gap is None else np.asarray(gap, bool)
        epochs = np.asarray(epoch, np.int64).reshape(-1)
        count = instants[0].size
        _require_columns(channel, count, (*instants, *bounds), (periods, gaps, epochs))
        begin, end, _ = self._spans[at].tolist()
        needed = end - begin + count
        if needed > self._capacity:
            raise MonitorError(
                f"{channel} would keep {needed} samples, more than {self._capacity}; take what is "
                "decided, or state the gap of a channel that is silent",
                value=needed,
            )
        if needed > self._columns.room // 2:  # else moves cost more than samples
            self._columns = self._columns.grown(needed)
        program, columns = self._program, self._columns
        added, wrong = accept(
            *instants, *bounds, periods, gaps, epochs, columns.times, columns.bounds, columns.gap,
            columns.codes, program.sides, program.thresholds, self._spans, at,
        )  # fmt: skip
        self._view = None
        for atom in program.coded[at]:
            self._code(atom, channel, at, added)
        if wrong >= 0:
            sample = tuple(each[wrong].item() for each in (*instants, *bounds))
            raise MonitorError(
                f"a sample of {channel} in [{sample[0]}, {sample[1]}] ns with [{sample[2]}, "
                f"{sample[3]}] is reversed, or not after the last one, or has NaN; correct it",
                value=sample,
            )

    def gap(self, channel: str, until: int | None = None) -> None:
        """State that samples are missing after the last one of a channel.

        Args:
            channel: Which one.
            until: No sample is there before this instant in ns; ``None`` where that is not known.

        Raises:
            MonitorError: The sample was stated to be held for longer.
        """
        for name, _ in self._read_by(channel):
            self._miss(name, until)

    def _miss(self, channel: str, until: int | None) -> None:
        at = self._place[channel]
        begin, end, known = self._spans[at].tolist()
        if known != NO_UNTIL and end > begin and not self._columns.gap[at, end - 1]:
            raise MonitorError(
                f"the last sample of {channel} is held until {known} ns; push one first",
                value=known,
            )
        if end > begin:
            self._columns.gap[at, end - 1] = True
        self._wait(at, until)

    def hold(self, channel: str, until: int) -> None:
        """State that the last sample of a channel is held: no other, and no gap, before an instant.

        Args:
            channel: Which one.
            until: The instant in ns.
        """
        for name, _ in self._read_by(channel):
            self._wait(self._place[name], until)

    def _wait(self, at: int, until: int | None) -> None:
        if until is not None:
            if abs(until) > MAX_INSTANT:
                raise MonitorError(f"until must be an instant in ns, not {until}", value=until)
            self._spans[at, 2] = max(self._spans[at, 2], until)
        self._view = None

    @property
    def verdicts(self) -> Verdicts:
        """The verdicts by what has arrived; of times that were taken, no more."""
        if self._view is None:
            self._view = Verdicts(Evaluation(self.formula, self._signals()))
        return self._view

    def take(self) -> list[Piece]:
        """The pieces that became final since the last call, without a hole between them.

        Two pieces of one verdict may follow each other.
        """
        if self._settled > END:
            return []
        while True:
            count, last = self._settle()
            if count != FULL:
                break
            _arena.grow()
        if count == 0:
            return []
        ticks, codes = (each[:count].tolist() for each in _arena.pieces)
        self._settled = last + 1
        self._view = None
        return [
            piece(first, behind - 1, code)
            for first, behind, code in zip(ticks, [*ticks[1:], last + 1], codes, strict=True)
        ]

    def __len__(self) -> int:
        """How many samples are kept."""
        return int((self._spans[:, 1] - self._spans[:, 0]).sum())

    def _settle(self) -> tuple[int, int]:
        program, columns = self._program, self._columns
        if program.listed:
            self._list()
        count, last = settle(
            program.lines, program.channel_of, program.of_any, columns.times, columns.gap,
            self._spans, self._past, columns.codes, columns.ticks, program.lists,
            program.frontiers, self._settled, _arena.lists, program.scratch, _arena.pieces,
        )  # fmt: skip
        return int(count), int(last)

    def _list(self) -> None:
        """Write the ticks of atoms over several channels to the beginning of the arena."""
        signals = self._signals()
        held = {name: held_samples(each) for name, each in signals.items()}
        top = 0
        for atom in self._program.listed:
            found = candidates(self._program.atoms[atom], signals, held)
            self._program.frontiers[atom] = found.frontier
            for side, runs in enumerate((found.where(~found.certain), found.where(found.possible))):
                behind = top + runs.first.size
                while behind > _arena.lists.shape[1]:
                    _arena.grow()
                _arena.lists[:, top:behind] = runs.first, runs.last
                self._program.lists[atom, 2 * side : 2 * side + 2] = top, behind - top
                top = behind

    def _signals(self) -> dict[str, Signal]:
        return {name: self._signal(name) for name in self._names}

    def _signal(self, name: str) -> Signal:
        at = self._place[name]
        begin, end, until = self._spans[at].tolist()
        earliest, latest, lo, hi, period, gap, epoch = (
            each[begin:end].copy() for each in self._columns.of_channel(at)
        )
        shared = self._shared.get(name)
        if shared is not None:
            shared = SharedError(shared.alpha, shared.beta, epoch, shared.name)
        return Signal(
            *(earliest, latest, lo, hi, period, gap),
            unit=self._units[name],
            coverage=self._coverage[name],
            until=None if until == NO_UNTIL else until,
            shared=shared,
        )

    def _code(self, atom: int, channel: str, at: int, first: int) -> None:
        """Write the codes of an atom over one channel, from a sample on."""
        end = self._spans[at, 1]
        _, _, lo, hi, *_ = self._columns.of_channel(at)
        values = Interval(lo[first:end], hi[first:end])
        self._columns.codes[atom, first:end] = _codes(
            self._program.atoms[atom], channel, values, self._units
        )

    def _read_by(self, channel: str) -> list[tuple[str, Prediction | None]]:
        """What a channel's samples are pushed to."""
        try:
            return self._readers[channel]
        except KeyError:
            raise MonitorError(
                f"the formula has no channel {channel}; push only {', '.join(self._readers)}",
                value=channel,
            ) from None


class _Columns(NamedTuple):
    """Samples that are still needed: a row a channel, or an atom."""

    times: NDArray[np.int64]
    bounds: NDArray[np.float64]
    gap: NDArray[np.bool_]
    codes: NDArray[np.int8]
    ticks: NDArray[np.int64]

    @classmethod
    def of(cls, channels: int, atoms: int, room: int) -> _Columns:
        return cls(
            np.empty((4, channels, room), np.int64),
            np.empty((2, channels, room), np.float64),
            np.zeros((channels, room), bool),
            np.zeros((atoms, room), np.int8),
            np.empty((2, channels, room), np.int64),
        )

    @property
    def room(self) -> int:
        return int(self.gap.shape[1])

    def of_channel(self, at: int) -> tuple[Any, ...]:
        """Earliest, latest, lo, hi, period, gap, epoch."""
        times, bounds = self.times[:, at], self.bounds[:, at]
        return times[0], times[1], bounds[0], bounds[1], times[2], self.gap[at], times[3]

    def grown(self, needed: int) -> _Columns:
        """Columns with room for twice as many samples as are needed, at least."""
        room = self.room
        while room < 2 * needed:
            room *= 2
        made = _Columns.of(self.gap.shape[0], self.codes.shape[0], room)
        pairs: Any = zip(self, made, strict=True)
        for each, larger in pairs:
            larger[..., : self.room] = each
        return made


class _Program(NamedTuple):
    """A formula as instructions, and its atoms.

    Attributes:
        atoms: The atoms.
        lines: A row an instruction, as `settle` reads them.
        channel_of: Place of each atom's channel, -1 where it has several.
        sides: By channel, `Side` of each atom.
        thresholds: Of each atom.
        of_any: Code of each atom for any value.
        coded: By channel, the atoms whose codes are evaluated here.
        listed: Atoms over several channels.
        lists, frontiers, scratch: Room, as of `settle`.
    """

    atoms: list[Atom]
    lines: NDArray[np.int64]
    channel_of: NDArray[np.int64]
    sides: NDArray[np.int64]
    thresholds: NDArray[np.float64]
    of_any: NDArray[np.int8]
    coded: list[list[int]]
    listed: list[int]
    lists: NDArray[np.int64]
    frontiers: NDArray[np.int64]
    scratch: tuple[Any, Any, Any, Any, Any]

    @classmethod
    def of(cls, formula: Formula, place: Mapping[str, int], units: Mapping[str, str]) -> _Program:
        atoms = list(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
        lines = instructions(formula, {atom: k for k, atom in enumerate(atoms)})
        channel_of = np.full(len(atoms), -1, np.int64)
        sides_ = np.full((len(place), len(atoms)), int(Side.LISTED), np.int64)
        thresholds = np.zeros(len(atoms))
        of_any = np.zeros(len(atoms), np.int8)
        coded: list[list[int]] = [[] for _ in place]
        listed = []
        for k, atom in enumerate(atoms):
            names = atom.variables
            if len(names) != 1 or any(delay for _, delay in names):
                listed.append(k)
                continue
            [(name, _)] = names
            at = channel_of[k] = place[name]
            whatever = Interval([-np.inf], [np.inf])
            of_any[k] = _codes(atom, name, whatever, units)[0]
            found = threshold(atom, units)
            if found is None:
                sides_[at, k] = int(Side.CODED)
                coded[at].append(k)
            else:
                sides_[at, k] = int(Side.AT_LEAST if found.upward else Side.AT_MOST)
                thresholds[k] = found.value
        most = 3 + max(int(line[1]) for line in lines)
        scratch = (
            np.empty((len(lines) + 1, 4), np.int64),
            np.empty((most, 2), np.int64),
            np.zeros((len(atoms), 4), np.int64),
            np.empty(most, np.int64),
            np.empty(most, bool),
        )
        return cls(
            atoms, np.array(lines, np.int64), channel_of, sides_, thresholds, of_any, coded, listed,
            np.zeros((len(atoms), 4), np.int64), np.zeros(len(atoms), np.int64), scratch,
        )  # fmt: skip


def _require_columns(
    channel: str,
    count: int,
    columns: tuple[NDArray[Any], ...],
    others: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
) -> None:
    periods, gaps, epochs = others
    if any(each.shape != (count,) for each in columns) or not (
        periods.size in {1, count} and epochs.size in {1, count} and gaps.size in {0, count}
    ):
        raise MonitorError(f"the columns of {channel} have different lengths; give all alike")
    if columns[0].dtype != np.int64 or columns[1].dtype != np.int64:
        raise MonitorError(
            f"instants of {channel} must be whole ns, int64; round outward", value=columns[0]
        )


def _codes(
    atom: Atom, channel: str, values: Interval, units: Mapping[str, str]
) -> NDArray[np.int8]:
    columns = Columns({(channel, 0): values})
    left, right = (side.value for side in comparison_of(atom, columns, units))
    certain, possible = judge(left, atom.comparison, right)
    shape = values.shape
    found: NDArray[np.int8] = np.where(np.broadcast_to(certain, shape), CERTAIN, 0).astype(np.int8)
    found[np.broadcast_to(possible, shape)] |= POSSIBLE
    return found
