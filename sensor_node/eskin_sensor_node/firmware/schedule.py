"""When a taxel's samples are taken, and which make a block: fewer while a viewer watches."""

_BILLION = 1000000000
MOST = 60 * _BILLION
"""ns for which one acknowledgement shortens blocks, at most."""


class Attention:
    """For how long, and how far, a node cuts its blocks.

    Args:
        length: ns of a block while a viewer watches; 0: blocks stay as they are designed.

    Attributes:
        until: Ticks at which it ends.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self.until = 0

    def hold(self, ticks: int, span: int) -> None:
        """A viewer watches for some ns more."""
        self.until = max(self.until, ticks + min(span, MOST))

    def most(self, ticks: int, dt: int) -> int:
        """Samples of a block that begins at some ticks; 0: as many as it is designed for."""
        if self._length == 0 or ticks >= self.until:
            return 0
        return max(1, self._length // dt)


class Frame:
    """The samples of one block.

    Attributes:
        number: Counts the taxel's frames.
        first: Number of the first sample.
        start: Ticks of the first sample.
        trigger: Ticks of the burst's trigger; 0 where sampling never pauses.
        n: Samples.
        dt: Sampling period in ns.
        closes: Whether sampling pauses after it.
    """

    __slots__ = ("closes", "dt", "first", "n", "number", "start", "trigger")

    def __init__(
        self, number: int, first: int, start: int, trigger: int, n: int, dt: int, *, closes: bool
    ) -> None:
        self.number = number
        self.first = first
        self.start = start
        self.trigger = trigger
        self.n = n
        self.dt = dt
        self.closes = closes

    def part(self, begin: int, end: int) -> "Frame":
        """Some of its samples; it closes with the last."""
        return Frame(
            self.number,
            self.first + begin,
            self.start + begin * self.dt,
            self.trigger,
            end - begin,
            self.dt,
            closes=self.closes and end == self.n,
        )

    def meets(self, other: "Frame") -> bool:
        """Whether another taxel's frame has its samples at the same instants."""
        return (self.start, self.n, self.dt) == (other.start, other.n, other.dt)

    @property
    def end(self) -> int:
        """Ticks at which the frame is complete."""
        return self.start + self.n * self.dt


class Schedule:
    """Equally spaced samples, without end or in bursts.

    Args:
        dt: Sampling period in ns.
        block: Samples in a block.
        burst: Samples in a burst; 0 where sampling never pauses.
        pause: ns from trigger to trigger.
        origin: Ticks of the first sample.
    """

    def __init__(
        self, dt: int, block: int, burst: int = 0, pause: int = 0, origin: int = 0
    ) -> None:
        self.dt = dt
        self.block = block
        self.burst = burst
        self.pause = max(pause, burst * dt)
        self.origin = origin

    def at_period(self, dt: int, origin: int) -> "Schedule":
        """As long blocks and bursts with another sampling period, from a moment on."""
        block = max(1, self.block * self.dt // dt)
        burst = max(1, self.burst * self.dt // dt) if self.burst else 0
        return Schedule(dt, block, burst, self.pause, origin)

    def frame(self, number: int) -> Frame:
        """The frame of a number."""
        if self.burst == 0:
            first = number * self.block
            start = self.origin + first * self.dt
            return Frame(number, first, start, 0, self.block, self.dt, closes=False)
        a_burst = -(-self.burst // self.block)
        burst, part = divmod(number, a_burst)
        trigger, before = self.origin + burst * self.pause, part * self.block
        n = min(self.block, self.burst - before)
        first, start = burst * self.burst + before, trigger + before * self.dt
        return Frame(number, first, start, trigger, n, self.dt, closes=part == a_burst - 1)

    def following(self, frame: Frame, most: int = 0) -> Frame:
        """The frame behind another one, or what is left of it: so many samples of it at most.

        Args:
            frame: The one before, whole or a part.
            most: Samples; 0: all that there are.
        """
        whole = self.frame(frame.number)
        begin = frame.first + frame.n - whole.first
        if begin >= whole.n:
            whole, begin = self.frame(frame.number + 1), 0
        end = whole.n if most == 0 else min(whole.n, begin + most)
        return whole.part(begin, end)

    def is_whole(self, frame: Frame) -> bool:
        """Whether a frame is all that its number stands for."""
        return frame.n == self.frame(frame.number).n

    def before(self, ticks: int) -> int:
        """How many samples are due before a moment."""
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
