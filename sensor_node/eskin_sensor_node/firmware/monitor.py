"""Monitors: formulas over the past, decided at each sample with three values (docs/monitors.md).

Time is counted in ticks of half a ns, by the node's clock: 2t is the instant t, and 2t + 1 the open
interval from t to t + 1. A set of ticks is a flat list of runs, ``first, last, first, last, …``,
ascending, with a hole between two.

From one sample to the next, the span, each operator takes where its operands are certain and where
they are possible, and gives where it is. What it remembers of the past it keeps as ticks of its own
result, where runs that touch are one; so a window that reaches up to now takes no more memory than
one run.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    Runs = list[int]
    Pair = tuple[Runs, Runs]
    """Where it is certain, and where it is possible."""
    Window = tuple[int, int]
    """From how many ns ago to how many."""
    Codes = tuple[int, int]
    """The first and the last code of a converter's that are meant; reversed for none."""
    Readings = Sequence[Sequence[int]]

ATOM = 0
NOT = 1
AT_LEAST = 2
FEWER = 3
IMPLIES = 4
HISTORICALLY = 7
ONCE = 8
SINCE = 10
RISE = 11
FALL = 12
"""Instructions, with the numbers of `eskin.monitor.program`; those about the future are missing."""
IMPOSSIBLE = 0
POSSIBLE = 1
CERTAIN = 2
"""Verdicts."""
WIDTH = 1
INSTANT = 2
GAP = 4
"""Why a verdict may be possible; see `Monitor.because`."""
BEGIN = 1 - (1 << 62)
"""The first tick: long before any sample."""
NEVER = 1, 0
"""No codes at all."""
_BILLION = 1000000000


class Source:
    """A taxel whose samples atoms compare.

    A sample holds until the next one, or for one period of true time if that does not come.

    Args:
        period: From sample to sample, ns of the clock.
        drift: Greatest error of the clock's rate, in parts of 1e9.

    Attributes:
        until: The last tick for which its latest sample holds, if no other comes.
        held: The last tick for which the sample before held.
        fresh: Whether it was sampled at the instant that is decided.
        readings: The codes of its inputs then; twice, where the input was an interval.
        broken: Whether its derived quantities mean nothing.
    """

    __slots__ = (
        "_drift", "_expected", "_lasting", "_period", "broken", "fresh", "held", "readings", "until"
    )  # fmt: skip

    def __init__(self, period: int, drift: int) -> None:
        self._drift = drift
        self.sample_every(period)
        self.until = self.held = self._expected = BEGIN - 1
        self.fresh = self.broken = False
        self.readings: Readings = ()

    def sample_every(self, period: int) -> None:
        """Take samples with another period, ns."""
        least = period if self._drift == 0 else windows(0, period, self._drift)[0][1]
        self._period, self._lasting = 2 * period, 2 * least - 1

    def take(self, now: int, readings: "Readings") -> None:
        """Take a sample of now."""
        self.held = 2 * now - 1 if 2 * now == self._expected else self.until
        self._expected, self.until = 2 * now + self._period, 2 * now + self._lasting
        self.fresh, self.readings = True, readings


class Atom:
    """A comparison: its verdict is held as long as the samples that it is made of.

    Args:
        sources: The taxels.
        derived: Whether it compares a quantity that a broken taxel does not measure.
        unknown: Verdict for any value.

    Attributes:
        sources: The taxels.
        fresh: Whether it was compared at the instant that is decided.
        width: Whether its latest verdict is open by the width of intervals.
        until: The last tick for which its latest verdict holds.
        before: The same of the verdict before.
    """

    def __init__(self, sources: "Sequence[Source]", unknown: int, *, derived: bool) -> None:
        self.sources = sources
        self._derived = derived
        self._unknown = unknown
        self._verdict = self._former = unknown
        self.fresh = self.width = False
        self.until = self.before = BEGIN - 1

    def take(self, now: int) -> None:
        """Compare the samples of now, and those of other taxels that are held."""
        self._former, self.fresh = self._verdict, True
        self.before = min([each.held if each.fresh else each.until for each in self.sources])
        self.until = min([source.until for source in self.sources])
        known = self.until >= 2 * now
        if self._derived and any(source.broken for source in self.sources):
            known, self.until = False, 2 * now
        self._verdict = self.compare() if known else self._unknown
        self.width = known and self._verdict == POSSIBLE

    def compare(self) -> int:
        """The verdict by the samples that are held."""
        raise NotImplementedError  # abstract: MicroPython has no abc

    def is_open(self, end: int) -> bool:
        """Whether a sample that is missing before the end of a span may have left it open."""
        held = self.before if self.fresh else self.until
        missing = held < end - 1 or (self.fresh and self.until <= end)
        return missing and self._unknown == POSSIBLE

    def feed(self, begin: int, end: int) -> "Pair":
        """Its verdict over a span."""
        pair: Pair = [], []
        held, until, last = self._verdict, self.until, end
        if self.fresh:
            held, until, last = self._former, self.before, end - 1
        until = min(until, last)
        _mark(pair, held, begin, until)
        _mark(pair, self._unknown, max(begin, until + 1), last)
        if self.fresh:
            _mark(pair, self._verdict, end, end)
        return pair


class Threshold(Atom):
    """Compares a channel with a constant, by codes of the converter alone.

    Args:
        source: The taxel.
        place: Which of its inputs.
        derived: As of every atom.
    """

    def __init__(self, source: Source, place: int, *, derived: bool) -> None:
        super().__init__((source,), POSSIBLE, derived=derived)
        self._place = place
        self.set(NEVER, NEVER)

    def set(self, certain: "Codes", possible: "Codes") -> None:
        """Compare with other codes from the next sample on.

        Args:
            certain: For which the comparison is true whatever the value.
            possible: For which it is true for some value.
        """
        self._certain = certain
        self._possible = possible

    def compare(self) -> int:
        """The verdict of the latest sample; where readings differ, it may be any between."""
        readings = self.sources[0].readings
        verdict = self._of(readings[0][self._place])
        for codes in readings[1:]:
            if self._of(codes[self._place]) != verdict:
                return POSSIBLE
        return verdict

    def _of(self, code: int) -> int:
        if self._certain[0] <= code <= self._certain[1]:
            return CERTAIN
        return POSSIBLE if self._possible[0] <= code <= self._possible[1] else IMPOSSIBLE


class _Past:
    """``once`` of one operand, or with ``negated`` ``historically``: not once not."""

    __slots__ = ("_negated", "_result", "_windows")

    def __init__(self, windows: "tuple[Window, Window]", *, negated: bool) -> None:
        self._windows = windows
        self._negated = negated
        self._result: tuple[Runs, Runs] = ([], [])

    def feed(self, parts: "Sequence[Pair]", begin: int, end: int) -> "Pair":
        found: list[Runs] = []
        for side in (0, 1):
            runs = parts[0][side]
            # What may fail is sought in the wider window, and what fails for certain in the other.
            window = self._windows[1 - side if self._negated else side]
            if self._negated:
                runs = complement(runs, begin, end)
            result = self._result[side]
            if window[0] <= window[1]:
                for k in range(0, len(runs), 2):
                    add(result, runs[k] + 2 * window[0], runs[k + 1] + 2 * window[1])
            taken = take(result, begin, end)
            found.append(complement(taken, begin, end) if self._negated else taken)
        return found[0], found[1]


class _Since:
    """``φ since ψ``: results of each ψ wait until their window comes, and end where φ does.

    φ must hold after ψ: at the open interval before which ψ is an instant, ψ may come just before.
    """

    __slots__ = ("_last", "_result", "_windows")

    def __init__(self, windows: "tuple[Window, Window]") -> None:
        self._windows = windows
        self._result: tuple[Runs, Runs] = ([], [])
        self._last = [(False, False), (False, False)]  # φ and ψ at the end of the span before

    def feed(self, parts: "Sequence[Pair]", begin: int, end: int) -> "Pair":
        ours, theirs = parts
        return (
            self._side(0, ours[0], theirs[0], begin, end),
            self._side(1, ours[1], theirs[1], begin, end),
        )

    def _side(self, side: int, ours: "Runs", theirs: "Runs", begin: int, end: int) -> "Runs":
        (a, b), result = self._windows[side], self._result[side]
        kept, was = self._last[side]
        self._last[side] = _holds(ours, end), _holds(theirs, end)
        out: Runs = []
        continues = kept and bool(ours) and ours[0] == begin
        if not continues:
            result.clear()
        for k in range(0, len(ours), 2):
            first, last = ours[k], ours[k + 1]
            reach = first - 1 if first % 2 else first
            if k > 0:
                result.clear()
            if a > b:
                continue
            if reach < begin and was and not continues:
                add(result, reach + 2 * a, reach + 2 * b)
            continues = False
            for j in range(0, len(theirs), 2):
                low, high = max(theirs[j], reach), min(theirs[j + 1], last)
                if low <= high:
                    add(result, low + 2 * a, high + 2 * b)
            taken = take(result, first, last)
            for j in range(0, len(taken), 2):
                add(out, taken[j], taken[j + 1])
        if a > 0 or a > b:
            return out
        return at_least((out, theirs), 1, begin, end)


class Monitor:
    """A formula over the past of some taxels.

    Args:
        lines: Its instructions, operands first: which one, how many operands it takes from the
            stack, from how many ns ago to how many it looks, and how many operands must hold.
            Instead of a window `ATOM` has the number of an atom.
        atoms: Its atoms.
        reach: ns of the past that it looks at.
        drift: Greatest error of the clock's rate, in parts of 1e9; windows are true ns.

    Attributes:
        verdict: At the latest sample.
        work: How many runs its instructions took so far.
    """

    def __init__(
        self,
        lines: "Sequence[tuple[int, int, int, int, int]]",
        atoms: "Sequence[Atom]",
        reach: int,
        drift: int,
    ) -> None:
        self._lines = [
            (line[0], line[1], line[2] if line[0] == ATOM else line[4], _operator(line, drift))
            for line in lines
        ]
        self.atoms = atoms
        self._reach = 2 * (reach + reach * drift // _BILLION + 2)
        self._uncertain = drift > 0 and reach > 0
        self._begin = BEGIN
        self._open = [BEGIN, BEGIN]  # the latest ticks at which a width and a gap left it open
        self.verdict = POSSIBLE
        self.work = 0

    def step(self, now: int) -> int:
        """Decide at an instant at which some of its taxels were sampled; later than the last one.

        Returns:
            Its verdict.
        """
        begin, end = self._begin, 2 * now
        stack: list[Pair] = []
        for op, taken, number, past in self._lines:
            if op == ATOM:
                stack.append(self._look(self.atoms[number], begin, end))
                continue
            parts = stack[len(stack) - taken :]
            del stack[len(stack) - taken :]
            stack.append(_combined(op, number, past, parts, begin, end))
            for lower, upper in parts:
                self.work += len(lower) + len(upper)
        for atom in self.atoms:
            atom.fresh = False
        self._begin = end + 1
        lower, upper = stack[0]
        if _holds(lower, end):
            self.verdict = CERTAIN
        else:
            self.verdict = POSSIBLE if _holds(upper, end) else IMPOSSIBLE
        return self.verdict

    @property
    def because(self) -> int:
        """Why its verdict is possible: all causes within the past that it looks at; else 0."""
        if self.verdict != POSSIBLE:
            return 0
        since = self._begin - self._reach
        found = (WIDTH if self._open[0] >= since else 0) | (GAP if self._open[1] >= since else 0)
        return found | (INSTANT if self._uncertain or not found else 0)

    def _look(self, atom: "Atom", begin: int, end: int) -> "Pair":
        self.work += 1
        if atom.width:
            self._open[0] = end
        if atom.is_open(end):
            self._open[1] = end
        return atom.feed(begin, end)


def windows(a: int, b: int, drift: int) -> "tuple[Window, Window]":
    """A window of true ns as ticks of a clock: what is inside for certain, and what may be."""
    if drift == 0:
        return (a, b), (a, b)
    fast, slow = _BILLION + drift, _BILLION - drift
    # A reading is cut to whole ns: one more.
    least = 0 if a == 0 else max(0, a * _BILLION // fast - 1)
    surely = 0 if a == 0 else -(-a * _BILLION // slow) + 1
    return (surely, b * _BILLION // fast - 1), (least, -(-b * _BILLION // slow) + 1)


def add(runs: "Runs", first: int, last: int) -> None:
    """Append a run that begins not before the last one; runs that touch become one."""
    if runs and first - 1 <= runs[-1]:
        runs[-1] = max(runs[-1], last)
    else:
        runs.append(first)
        runs.append(last)


def take(runs: "Runs", begin: int, end: int) -> "Runs":
    """What lies in a span; what ends before it is forgotten."""
    gone = 0
    while gone < len(runs) and runs[gone + 1] < begin:
        gone += 2
    if gone:
        del runs[:gone]
    found: Runs = []
    for k in range(0, len(runs), 2):
        if runs[k] > end:
            break
        found.append(max(runs[k], begin))
        found.append(min(runs[k + 1], end))
    return found


def complement(runs: "Runs", begin: int, end: int) -> "Runs":
    """The rest of a span."""
    found: Runs = []
    for k in range(0, len(runs), 2):
        if begin < runs[k]:
            found.append(begin)
            found.append(runs[k] - 1)
        begin = runs[k + 1] + 1
    if begin <= end:
        found.append(begin)
        found.append(end)
    return found


def at_least(lists: "Sequence[Runs]", number: int, begin: int, end: int) -> "Runs":
    """Ticks of a span that are in so many of the lists."""
    if number <= 0:
        return [begin, end]
    edges: list[tuple[int, int]] = []
    for runs in lists:
        for k in range(0, len(runs), 2):
            edges.append((runs[k], 1))
            edges.append((runs[k + 1] + 1, -1))
    edges.sort()
    found: Runs = []
    count = first = 0
    for tick, change in edges:
        if count == number and change < 0:
            add(found, first, tick - 1)
        count += change
        if count == number and change > 0:
            first = tick
    return found


def _mark(pair: "Pair", verdict: int, first: int, last: int) -> None:
    if first <= last:
        if verdict == CERTAIN:
            add(pair[0], first, last)
        if verdict != IMPOSSIBLE:
            add(pair[1], first, last)


def _holds(runs: "Runs", end: int) -> bool:
    """Whether a set holds at the end of its span."""
    return bool(runs) and runs[-1] == end


def _just_before(runs: "Runs") -> "Runs":
    """Ticks just before which a set holds: open intervals in it, and instants at their ends."""
    found: Runs = []
    for k in range(0, len(runs), 2):
        first, last = runs[k] | 1, runs[k + 1]
        if last % 2 == 0:
            last -= 1
        if first <= last:
            add(found, first, last + 1)
    return found


def _operator(line: "Sequence[int]", drift: int) -> "_Past | _Since | None":
    """What remembers the past for an instruction."""
    op, _, a, b, _ = line
    if op == SINCE:
        return _Since(windows(a, b, drift))
    if op in (ONCE, HISTORICALLY):
        return _Past(windows(a, b, drift), negated=op == HISTORICALLY)
    return None


def _combined(
    op: int,
    number: int,
    past: "_Past | _Since | None",
    parts: "Sequence[Pair]",
    begin: int,
    end: int,
) -> "Pair":
    """An operator over a span; a negation exchanges what is certain and what is possible."""
    if past is not None:
        return past.feed(parts, begin, end)
    lower, upper = parts[0]
    if op in (AT_LEAST, FEWER):
        surely = at_least([part[0] for part in parts], number, begin, end)
        maybe = at_least([part[1] for part in parts], number, begin, end)
        if op == AT_LEAST:
            return surely, maybe
        return complement(maybe, begin, end), complement(surely, begin, end)
    never, not_surely = complement(upper, begin, end), complement(lower, begin, end)
    if op == NOT:
        return never, not_surely
    if op == IMPLIES:
        surely = at_least((never, parts[1][0]), 1, begin, end)
        return surely, at_least((not_surely, parts[1][1]), 1, begin, end)
    now, then = ((lower, upper), (never, not_surely))
    if op == FALL:
        now, then = then, now
    surely = at_least((now[0], _just_before(then[0])), 2, begin, end)
    return surely, at_least((now[1], _just_before(then[1])), 2, begin, end)
