"""Ticks of a crystal, and the UTC time that they stand for."""

_BILLION = 1000000000


class Clock:
    """What the node knows of time: a reading at its start, and how far it may be wrong.

    Args:
        reading: UTC at tick 0, ns since 1970, by the real-time clock.
        error: Greatest error of that reading, ns.
        drift: Greatest error of the crystal, in parts of 1e9.
    """

    def __init__(self, reading: int, error: int, drift: int) -> None:
        self._reading = reading
        self._error = error
        self._drift = drift

    def enclosure(self, ticks: int, lasting: int = 0) -> "tuple[int, int]":
        """Earliest and latest UTC in ns of an instant.

        Args:
            ticks: Nominal ns since the start.
            lasting: Nominal ns after it for which the bounds, moved on by nominal ns, still hold.
        """
        error = self._error - (-(ticks + lasting) * self._drift // _BILLION)
        middle = self._reading + ticks
        return middle - error, middle + error
