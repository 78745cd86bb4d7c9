"""When a taxel's samples are taken, and which of them lie in one stretch of time."""

MOST_ROWS = 1000
"""Samples of a channel in one frame."""


class Frame:
    """The samples of one taxel in one stretch.

    Attributes:
        first: Number of the first sample.
        start: Ticks of the first sample.
        trigger: Ticks of the burst's trigger; 0 where sampling never pauses.
        n: Samples.
        dt: Sampling period in ns.
        due: Ticks at which it can be processed: at the end of the stretch.
        closes: Whether sampling pauses after it.
    """

    __slots__ = ("closes", "dt", "due", "first", "n", "start", "trigger")

    def __init__(
        self, first: int, start: int, trigger: int, n: int, dt: int, due: int, *, closes: bool
    ) -> None:
        self.first = first
        self.start = start
        self.trigger = trigger
        self.n = n
        self.dt = dt
        self.due = due
        self.closes = closes

    def part(self, begin: int, end: int) -> "Frame":
        """Some of its samples; it closes with the last."""
        return Frame(
            self.first + begin,
            self.start + begin * self.dt,
            self.trigger,
            end - begin,
            self.dt,
            self.due,
            closes=self.closes and end == self.n,
        )

    def meets(self, other: "Frame") -> bool:
        """Whether another taxel's frame has its samples at the same instants."""
        return (self.start, self.n, self.dt) == (other.start, other.n, other.dt)

    @property
    def end(self) -> int:
        """Ticks until which its last sample holds."""
        return self.start + self.n * self.dt


class Schedule:
    """Equally spaced samples, without end or in bursts, cut into stretches.

    All taxels of a node have the same stretches, which begin at whole multiples of their length.

    Args:
        dt: Sampling period in ns.
        stretch: Length of a stretch, ns.
        most: Samples in a frame, at most.
        burst: Samples in a burst; 0 where sampling never pauses.
        pause: ns from trigger to trigger.
        origin: Ticks of the first sample, a whole multiple of the period.
    """

    __slots__ = ("burst", "dt", "most", "origin", "pause", "stretch")

    def __init__(
        self, dt: int, stretch: int, most: int, burst: int = 0, pause: int = 0, origin: int = 0
    ) -> None:
        self.dt = dt
        self.stretch = stretch
        self.most = most
        self.burst = burst
        self.pause = max(pause, burst * dt)
        self.origin = origin

    def at_period(self, dt: int, ticks: int) -> "Schedule":
        """As long bursts with another sampling period, from an instant on.

        The first sample is taken at a whole multiple of the period, so that taxels with a half,
        a quarter, … of the rate are sampled together with the others.
        """
        burst = max(1, self.burst * self.dt // dt) if self.burst else 0
        origin = -(-ticks // dt) * dt
        return Schedule(dt, self.stretch, self.most, burst, self.pause, origin)

    @property
    def capacity(self) -> int:
        """Samples that a frame has at most."""
        return min(self.most, -(-self.stretch // self.dt))

    def frame(self, first: int) -> Frame:
        """The samples from a number on, to the end of their stretch or burst."""
        start = self.ticks(first)
        due = (start // self.stretch + 1) * self.stretch
        n = -((start - due) // self.dt)
        if n > self.most:
            n = self.most
            due = start + n * self.dt
        if self.burst == 0:
            return Frame(first, start, 0, n, self.dt, due, closes=False)
        number, inside = divmod(first, self.burst)
        n = min(n, self.burst - inside)
        trigger = self.origin + number * self.pause
        if inside + n == self.burst:
            # The next burst is on a grid of its own.
            due = min(due, trigger + self.pause)
        return Frame(first, start, trigger, n, self.dt, due, closes=inside + n == self.burst)

    def following(self, frame: Frame) -> Frame:
        """The frame behind another one."""
        return self.frame(frame.first + frame.n)

    def before(self, ticks: int) -> int:
        """How many samples are due before an instant."""
        since = max(0, ticks - self.origin)
        if self.burst == 0:
            return -(-since // self.dt)
        bursts, inside = divmod(since, self.pause)
        return bursts * self.burst + min(self.burst, -(-inside // self.dt))

    def ticks(self, sample: int) -> int:
        """When a sample is taken."""
        if self.burst == 0:
            return self.origin + sample * self.dt
        burst, inside = divmod(sample, self.burst)
        return self.origin + burst * self.pause + inside * self.dt
