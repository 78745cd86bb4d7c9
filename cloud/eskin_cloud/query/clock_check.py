"""Whether a node's statement of UTC holds, by what messages prove."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy import func, or_, select

from eskin.errors import StoreError
from eskin_cloud.store.schema.tables import nodes

if TYPE_CHECKING:
    from typing import Literal

    from eskin_cloud.store import Store


@dataclass(frozen=True, slots=True)
class ClockCheck:
    """A node's statement of the moment at which it wrote a status, beside two proofs of it.

    The status carries the gateway's time in an acknowledgement that the node had received, so it
    was written after that time. The cloud stored it, so it was written before it was stored. This
    is Cristian's method (1989) with the network's delay left as an interval.

    Attributes:
        stated: What the node's clock says: earliest and latest, UTC ns.
        after: Gateway's time in the acknowledgement, UTC ns; ``None`` where the node had none.
        before: When the cloud stored the status, UTC ns.
        error: Greatest error of the gateways' clocks and of the cloud's, ns.
    """

    stated: tuple[int, int]
    after: int | None
    before: int
    error: int

    @property
    def references_agree(self) -> bool:
        """Whether both proofs can hold; else the gateway's clock or the cloud's is wrong."""
        return self.after is None or self.after - self.error <= self.before + self.error

    @property
    def verdict(self) -> Literal["certain", "possible", "impossible"]:
        """Whether the stated enclosure holds the moment.

        ``impossible`` proves that the node's clock is beyond its stated bound. ``certain`` says
        that no clock of a node is needed to believe the enclosure.
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
        """Enclosure of the clock's offset: the middle of ``stated`` minus the true moment, ns.

        A side is ``None`` where nothing bounds it.
        """
        if not self.references_agree:
            return None, None
        middle, odd = divmod(sum(self.stated), 2)
        most = None if self.after is None else middle + odd - (self.after - self.error)
        return middle - (self.before + self.error), most


def count_wrong_clocks(store: Store, error: int) -> float:
    """How many nodes' clocks are impossible by their latest status; NaN if it cannot be read.

    Args:
        store: Where the statuses are.
        error: As in `ClockCheck`.
    """
    stated, proven = nodes.c, 2 * error
    wrong = or_(
        stated.clock_earliest - stated.clock_before > error,
        stated.clock_after - stated.clock_latest > error,
    )
    # Where the reference clocks contradict each other, they say nothing about the node.
    agree = func.coalesce(stated.clock_after - stated.clock_before, 0) <= proven
    try:
        with store.read() as connection:
            counted = select(func.count()).select_from(nodes).where(wrong, agree)
            return float(connection.execute(counted).scalar_one())
    except StoreError:
        return math.nan
