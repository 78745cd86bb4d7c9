"""Short blocks while somebody looks on: what is seen at once is worth a message of its own."""

_BILLION = 1000000000
MOST = 60 * _BILLION
"""ns for which one word of a gateway shortens blocks, at most."""


class Attention:
    """For how long, and how far, a node cuts its blocks.

    Args:
        length: ns of a block while somebody looks on; 0: blocks stay as they are designed.

    Attributes:
        until: Ticks at which it ends.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self.until = 0

    def hold(self, ticks: int, span: int) -> None:
        """Somebody looks on for some ns more."""
        self.until = max(self.until, ticks + min(span, MOST))

    def most(self, ticks: int, dt: int) -> int:
        """Samples of a block that begins at some ticks; 0: as many as it is designed for."""
        if self._length == 0 or ticks >= self.until:
            return 0
        return max(1, self._length // dt)
