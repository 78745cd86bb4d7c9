"""Digital outputs of the machine, which reflexes drive."""

from __future__ import annotations

import logging
from collections import deque
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

NAMES: Final = ("stop", "out1", "out2", "out3")
"""Outputs that a machine has."""
_KEPT: Final = 10_000


class Edge(NamedTuple):
    """A change of an output.

    Attributes:
        time: Machine time in ns.
        output: Which one.
        level: Whether it is on from then on.
        cause: Machine time of the conversion that it follows from, ns.
    """

    time: int
    output: str
    level: bool
    cause: int


class Outputs:
    """Levels of all outputs; a machine that has no power drives none.

    Attributes:
        edges: The latest changes.
        on_edge: Called with each change; ``None``: nothing is connected.
    """

    def __init__(self) -> None:
        self._on: set[str] = set()
        self.edges: deque[Edge] = deque(maxlen=_KEPT)
        self.on_edge: Callable[[Edge], None] | None = None

    def is_on(self, output: str) -> bool:
        """Whether an output is on."""
        return output in self._on

    def drive(self, output: str, *, level: bool, time: int, cause: int) -> None:
        """Set an output at a machine time."""
        if level is (output in self._on):
            return
        if level:
            self._on.add(output)
        else:
            self._on.discard(output)
        edge = Edge(time, output, level, cause)
        self.edges.append(edge)
        log.debug(
            "output changed: name=%s level=%s reaction_us=%.1f",
            output, "on" if level else "off", (time - cause) / 1e3,
        )  # fmt: skip
        if self.on_edge is not None:
            self.on_edge(edge)

    def release(self, time: int) -> None:
        """Turn all outputs off, as at a reset."""
        for output in sorted(self._on):
            self.drive(output, level=False, time=time, cause=time)
