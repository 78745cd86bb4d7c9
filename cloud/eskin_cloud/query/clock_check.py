"""Check a node's stated time by the times of its messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy import func, or_, select

from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from typing import Literal

    from sqlalchemy import Connection


@dataclass(frozen=True, slots=True)
class ClockCheck:
    """The time that a node stated in a status, and two bounds of it.

    The status holds the gateway's time from the latest acknowledgement, so the node wrote it after
    that time, and before the cloud stored it. This is Cristian's method (1989) with the network's
    delay as an interval.

    Attributes:
        stated: The node's time: earliest and latest, UTC ns.
        after: Gateway's time in the acknowledgement, UTC ns; ``None`` if the node had none.
        before: When the cloud stored the status, UTC ns.
        error: Greatest error of the gateways' clocks and of the cloud's, ns.
    """

    stated: tuple[int, int]
    after: int | None
    before: int
    error: int

    @property
    def references_agree(self) -> bool:
        """Whether both bounds can hold; else the gateway's clock or the cloud's is wrong."""
        return self.after is None or self.after - self.error <= self.before + self.error

    @property
    def verdict(self) -> Literal["certain", "possible", "impossible"]:
        """Whether the stated enclosure holds the true time.

        ``impossible`` proves that the node's clock exceeds its stated error. ``certain`` is proven
        by the gateway's and the cloud's clocks alone.
        """
        if not self.references_agree:
            return "possible"
        earliest, latest = self.stated
        end = self.before + self.error
        begin = None if self.after is None else self.after - self.error
        if earliest > end or (begin is not None and latest < begin):
            return "impossible"
        return (
            "certain" if begin is not None and earliest <= begin and end <= latest else "possible"
        )

    @property
    def offset(self) -> tuple[int | None, int | None]:
        """Enclosure of the clock's offset: the middle of ``stated`` minus the true instant, ns.

        A side is ``None`` where nothing bounds it.
        """
        if not self.references_agree:
            return None, None
        middle, odd = divmod(sum(self.stated), 2)
        most = None if self.after is None else middle + odd - (self.after - self.error)
        return middle - (self.before + self.error), most


def count_wrong_clocks(connection: Connection, error: int) -> int:
    """The number of nodes whose latest status proves their clock wrong.

    Args:
        connection: Of the store.
        error: As in `ClockCheck`.
    """
    stated, proven = nodes.c, 2 * error
    wrong = or_(
        stated.clock_earliest - stated.clock_before > error,
        stated.clock_after - stated.clock_latest > error,
    )
    # Reference clocks that contradict each other prove nothing about the node.
    agree = func.coalesce(stated.clock_after - stated.clock_before, 0) <= proven
    counted = select(func.count()).select_from(nodes).where(wrong, agree)
    return int(connection.execute(counted).scalar_one())
