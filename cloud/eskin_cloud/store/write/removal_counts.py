"""Numbers of removed messages, by place and reason."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from sqlalchemy import insert, update

from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.sealed_tables import removals

if TYPE_CHECKING:
    from sqlalchemy import Connection


class RemovalReason(StrEnum):
    """Reasons of removal."""

    AGE = "age"
    ERASURE = "erasure"


@dataclass(frozen=True, slots=True)
class Sweep:
    """What to remove of sealed messages, or was removed of a place.

    Attributes:
        node: The node.
        place: Their place, as `eskin.privacy.sealed_message.name_place` names it.
        reason: Why.
        before: Messages that ended before it are removed, UTC ns; of erased subjects, all are.
    """

    node: str
    place: str
    reason: RemovalReason
    before: int


def record_removal(connection: Connection, sweep: Sweep, gone: int, now: int) -> None:
    """Count removed messages of a place.

    Args:
        connection: The writer's, in a transaction.
        sweep: What was removed.
        gone: Number of messages.
        now: UTC ns.
    """
    r = removals.c
    here = of_node(removals, sweep.node) & (r.place == sweep.place) & (r.reason == sweep.reason)
    values = {"messages": r.messages + gone, "before": sweep.before, "at": now}
    if connection.execute(update(removals).where(here).values(values)).rowcount == 0:
        key = {"node": sweep.node, "place": sweep.place, "reason": sweep.reason.value}
        row = key | {"messages": gone, "before": sweep.before, "at": now}
        connection.execute(insert(removals), row)
