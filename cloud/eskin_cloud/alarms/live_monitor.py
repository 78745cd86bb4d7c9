"""One monitor over live data: what the store holds first, then sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import EskinError, MonitorError
from eskin.interval import Verdict
from eskin.monitor import Monitor, horizon
from eskin.monitor.runs import Runs
from eskin_cloud.alarms.episodes import Edge, Episodes, VerdictStretch
from eskin_cloud.query.channel_runs import ChannelSource, as_signal, read_around
from eskin_cloud.query.formula_channels import channel_places, parse_formula
from eskin_cloud.query.stored_verdicts import MOST_READS, StoredVerdicts
from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.write.alarms import AlarmChange, find_episodes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin.interval import Floats
    from eskin.monitor.verdicts import Piece
    from eskin_cloud.store.column_runs import ColumnRun
    from eskin_cloud.store.feed_entry import FeedPosition

    Integers = NDArray[np.int64]

MOST_KEPT: Final = 2**17
"""Samples of a channel that a live monitor may keep."""
LATE_NS: Final = 6 * 3_600_000_000_000
"""Samples that arrive so much later than those after them raise no alarm."""
_MARGIN_NS: Final = 1_000_000_000
_WIDER: Final = 8
"""So far before late samples it is looked at first for where no episode goes on, and so many times
as far then."""
_READS: Final = 200
"""Stretches of stored samples that are evaluated at once, so that other monitors do not wait."""


@dataclass(frozen=True, slots=True)
class Instants:
    """When samples that arrived together were taken, in order of time.

    Attributes:
        first: Middle of the first one's time, UTC ns.
        last: That of the last one.
        earliest: Each one's earliest instant.
        latest: Each one's latest instant.
        period: Of each, ns.
        gap: Whether samples are missing after it.
        ordered: Whether they ascend.
    """

    first: int
    last: int
    earliest: Integers
    latest: Integers
    period: Integers
    gap: NDArray[np.bool_]
    ordered: bool

    @classmethod
    def of(cls, runs: Sequence[ColumnRun]) -> Instants:
        """Those of some runs, in their order."""
        n = [run.lo.size for run in runs]
        t = np.concatenate([run.t + run.dt * np.arange(run.lo.size) for run in runs])
        heads = np.array([(run.error, run.dt) for run in runs], np.int64)
        error, period = np.repeat(heads, n, axis=0).T
        steps = np.diff(t)
        gap = np.append(steps > longest_step(period[:-1]), False)
        return cls(
            int(t[0]), int(t[-1]), t - error, t + error, period, gap, bool(np.all(steps > 0))
        )


class Samples(NamedTuple):
    """Samples of a channel that arrived together.

    Attributes:
        instants: When they were taken; channels of a patch share them.
        lo: Lower bounds.
        hi: Upper bounds.
    """

    instants: Instants
    lo: Floats
    hi: Floats


class LiveMonitor:
    """A monitor, from the tick on up to which it has been evaluated.

    What is stored is evaluated as by a query (`StoredVerdicts`), pyramid first. The last samples
    of it are then given to an online monitor, which takes what arrives. Not thread-safe.

    Args:
        row: Its row in `schema.alarm_tables.monitors`.
        is_open: Whether it has an open alarm.
        examined: Whether all late samples that have come were evaluated.

    Attributes:
        name: Its name.
        revision: Of its definition.
        places: Node and channel of each channel, by its name in the formula.
        settled: Verdicts before this tick have been evaluated.
        latest: The last stretch that was.
        problem: Why it is not evaluated now; ``None`` where it is.
        position: What the store held up to here has been read; ``None`` where it must be read
            again.

    Raises:
        QueryError: The formula is invalid.
    """

    def __init__(self, row: RowMapping, *, is_open: bool, examined: bool = False) -> None:
        self.name: str = row["name"]
        self.revision: int = row["revision"]
        self.formula = parse_formula(row["formula"])
        self.places = channel_places(self.formula, row["node"])
        self.settled: int = row["settled"]
        self.latest: VerdictStretch | None = None
        self.problem: str | None = None
        self.position: FeedPosition | None = None
        self._since: int = row["changed"]
        self._missing = bool(row["missing"])
        self._on_possible = row["raise_on"] == "possible"
        self._clear_after: int = row["clear_after"]
        self._raises = row["raise_on"] != "never"
        self._episodes = self._new_episodes(is_open=is_open)
        past, future = horizon(self.formula)
        self._past, self._future = past or 0, future or 0
        self._online: Monitor | None = None
        self._last: dict[str, tuple[int, int]] = {}  # time and period of the last samples
        begun = self.settled <= 2 * self._since
        self._late: int | None = None if begun or examined else self._since

    @property
    def resumes(self) -> int:
        """The tick from which another process would have to evaluate."""
        quiet = self._episodes.quiet
        return self.settled if quiet is None else min(quiet, self.settled)

    @property
    def examined(self) -> bool:
        """Whether all late samples that have come were evaluated."""
        return self._late is None

    @property
    def is_open(self) -> bool:
        """Whether an episode goes on."""
        return self._episodes.is_open

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes whose channels it reads."""
        return tuple(sorted({node for node, _ in self.places.values()}))

    def misses(self, cursor: int) -> bool:
        """Whether it has not read an entry from the store."""
        return self.position is None or cursor not in self.position

    def take(self, name: str, samples: Samples) -> None:
        """Take samples of a channel that arrived."""
        instants = samples.instants
        if self._online is None:  # they are read from the store
            earliest = int(instants.earliest.min())
            if 2 * earliest < self.settled:
                self._note_late(earliest)
            return
        last, period = self._last[name]
        if instants.first <= last or not instants.ordered:
            self._note_late(int(instants.earliest.min()))
            return
        try:
            if instants.first - last > period + period // 2:
                self._online.gap(name)
            self._online.extend(
                name,
                instants.earliest,
                instants.latest,
                samples.lo,
                samples.hi,
                instants.period,
                instants.gap,
            )
        except MonitorError:  # read it from the store, as a query does
            self._note_late(int(instants.earliest.min()))
            return
        self._last[name] = instants.last, int(instants.period[-1])

    def advance(self) -> list[AlarmChange]:
        """Evaluate what is decided for good by now."""
        if self._online is None:
            return []
        held = None
        if self._on_possible and not self._missing:
            held = self._online.verdicts.held_by_samples()
        stretches = _stretches(self._online.take(), self.settled, held)
        return self._add(stretches)

    def catch_up(self, connection: Connection, *, position: FeedPosition) -> list[AlarmChange]:
        """Evaluate what is stored, and read the samples with which the next ones are evaluated.

        Args:
            connection: In a read transaction.
            position: The last one that it shows.

        Raises:
            EskinError: A channel is not there, or the formula does not fit it. Nothing was
                evaluated.
        """
        self.leave()
        sources = {
            name: ChannelSource(connection, find_channel(connection, *place))
            for name, place in self.places.items()
        }
        for name, source in sources.items():
            if source.channel["t_last"] is None:
                raise MonitorError(f"{'/'.join(self.places[name])} has no samples yet", value=name)
        changes = self._reexamine(connection, sources)
        newest = min(self._known_until(source) for source in sources.values())
        end = newest - self._future
        if 2 * end > self.settled:
            changes += self._evaluate_stored(sources, end)
            if 2 * end > self.settled:
                return changes  # it takes several calls
        try:
            self._seed(sources)
        except EskinError as error:  # what was evaluated counts
            self.problem = str(error)
            return changes
        self.position, self.problem = position, None
        return changes + self.advance()

    def note_silence(self, now: int, silence: int) -> list[AlarmChange]:
        """Raise an alarm where missing samples count, and none came for a time in ns."""
        if not self._missing or not self._last:
            return []
        last = min(t for t, _ in self._last.values())
        if now - last <= silence or self._episodes.is_open:
            return []
        since = max(2 * last + 1, self.settled)
        return self._add(
            [VerdictStretch(since, since, Verdict.POSSIBLE, missing=True)], settles=False
        )

    def _evaluate_stored(self, sources: dict[str, ChannelSource], end: int) -> list[AlarmChange]:
        """Evaluate stored samples up to an instant, or as far as one call may."""
        window = Window(self.settled // 2, end)
        for most in (_READS, MOST_READS):
            stored = StoredVerdicts(self.formula, sources, most_reads=most)
            found = [
                VerdictStretch(max(each.first, self.settled), each.last, each.verdict, each.missing)
                for each in stored.pieces(window)
                if each.last >= self.settled
            ]
            if found:
                return self._add(found)
        raise MonitorError(
            f"{MOST_READS} stretches after {window.start} ns stay open", value=window
        )

    def _seed(self, sources: dict[str, ChannelSource]) -> None:
        units = {name: source.channel["unit"] for name, source in sources.items()}
        online = Monitor(self.formula, units, capacity=MOST_KEPT)
        start = self.settled // 2 - self._past - self._future
        for name, source in sources.items():
            channel = source.channel
            count = (channel["t_last"] - start) // max(channel["dt"], 1)
            if count > MOST_KEPT:
                raise MonitorError(
                    f"{count} samples of {'/'.join(self.places[name])} are needed at once, more "
                    f"than the {MOST_KEPT} that a live monitor keeps; shorten its windows, or wait "
                    "for channels that are behind",
                    value=count,
                )
            samples = read_around(source, Window(start, channel["t_last"] + 1))
            signal = as_signal(samples, channel["unit"])
            online.extend(
                name,
                signal.earliest,
                signal.latest,
                signal.lo,
                signal.hi,
                signal.period,
                signal.gap,
            )
            if not len(samples):
                raise MonitorError(f"{'/'.join(self.places[name])} has no intact samples")
            self._last[name] = int(samples.first[-1]), int(samples.dt[-1])
        self._online = online

    def _reexamine(
        self, connection: Connection, sources: dict[str, ChannelSource]
    ) -> list[AlarmChange]:
        """Raise what late samples show: episodes that no alarm stands for."""
        if self._late is None or not self._raises:
            self._late = None
            return []
        least = max(self._since, self.settled // 2 - LATE_NS)
        begin = max(self._late - self._future, least)
        stretches: list[VerdictStretch] = []
        if 2 * begin < self.settled:
            stretches = self._stretches_around(sources, begin, least)
        self._late = None
        begin = stretches[0].first // 2 if stretches else begin
        edges = self._new_episodes(is_open=False).add(stretches)
        known = find_episodes(connection, self.name, self.revision, 2 * begin)
        changes = []
        for edge, after in zip_longest(edges, edges[1:]):
            if edge.verdict is None:
                continue
            ended = None if after is None else after.tick
            if any(
                (ended is None or began < ended) and (stop is None or edge.tick < stop)
                for began, stop in known
            ):
                continue
            if ended is None:
                self._episodes.is_open = True
            changes.append(self._change(edge, ended))
        return changes

    def _stretches_around(
        self, sources: dict[str, ChannelSource], begin: int, least: int
    ) -> list[VerdictStretch]:
        """Verdicts from before an instant, where no episode goes on, up to what is settled."""
        end = -(-self.settled // 2)
        margin = _MARGIN_NS
        while True:
            start = max(begin - margin, least)
            found = [
                VerdictStretch(
                    each.first, min(each.last, self.settled - 1), each.verdict, each.missing
                )
                for each in StoredVerdicts(self.formula, sources).pieces(Window(start, end))
                if each.first < self.settled
            ]
            quiet = (
                min(each.last + 1, 2 * begin) - each.first
                for each in found
                if each.verdict is Verdict.IMPOSSIBLE
            )
            if start == least or max(quiet, default=0) > 2 * self._clear_after:
                return found
            margin *= _WIDER

    def _add(
        self, stretches: Sequence[VerdictStretch], *, settles: bool = True
    ) -> list[AlarmChange]:
        if not stretches:
            return []
        if settles:
            self.latest = stretches[-1]
            self.settled = stretches[-1].last + 1
        if not self._raises:
            return []
        return [self._change(edge) for edge in self._episodes.add(stretches)]

    def _change(self, edge: Edge, ended: int | None = None) -> AlarmChange:
        verdict = None if edge.verdict is None else edge.verdict.name.lower()
        return AlarmChange(self.name, self.revision, edge.tick, verdict, self.nodes, ended)

    def _new_episodes(self, *, is_open: bool) -> Episodes:
        return Episodes(
            on_possible=self._on_possible,
            missing=self._missing,
            clear_after=self._clear_after,
            is_open=is_open,
        )

    def reexamine(self) -> None:
        """Evaluate again what late samples may have changed, whatever has come."""
        self._note_late(self._since)

    def leave(self) -> None:
        """Read from the store what comes next."""
        self._online, self.position = None, None

    def _note_late(self, instant: int) -> None:
        self._late = instant if self._late is None else min(self._late, instant)
        self.leave()

    @staticmethod
    def _known_until(source: ChannelSource) -> int:
        """An instant before which later samples of a channel change nothing."""
        last = source.channel["t_last"]
        samples = read_around(source, Window(last, last + 1))
        if not len(samples):
            channel = source.channel
            raise MonitorError(f"{channel['node']}/{channel['channel']} has no intact samples")
        return int((samples.first - samples.error)[-1]) - 1


def _stretches(pieces: Iterable[Piece], since: int, held: Runs | None) -> list[VerdictStretch]:
    """Verdicts from a tick on; `held` are the ticks at which they could hold by samples."""
    found: list[VerdictStretch] = []
    for each in pieces:
        first = since if each.start is None else 2 * each.start + (not each.includes_start)
        assert each.end is not None  # noqa: S101 - later samples may always come
        last = 2 * each.end - (not each.includes_end)
        first = max(first, since)
        if first > last:
            continue
        if each.verdict is not Verdict.POSSIBLE or held is None:
            found.append(VerdictStretch(first, last, each.verdict, missing=False))
            continue
        known = held & Runs.between(first, last)
        for runs, missing in ((known, False), (~known & Runs.between(first, last), True)):
            found += [
                VerdictStretch(int(a), int(b), each.verdict, missing=missing)
                for a, b in zip(runs.first, runs.last, strict=True)
            ]
    return sorted(found)
