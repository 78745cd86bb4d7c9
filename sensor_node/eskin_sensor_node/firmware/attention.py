"""Short blocks while a viewer watches."""

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
