"""Commands, and the desired and reported settings of nodes."""

from collections import defaultdict
from typing import Literal, Self

import orjson
from pydantic import BaseModel

from eskin_cloud.commands.desired_state import is_settled
from eskin_cloud.schemas.base import Instant, Row, TimeDocument, time_span


class CommandDocument(BaseModel):
    """A command.

    ``expired`` without an answer may still turn into what the node says: it may have done it in
    time, and its word is on its way.
    """

    id: int
    node: str
    name: Literal["calibrate", "set", "reset", "monitor", "challenge"]
    arguments: dict[str, float | str]
    state: Literal["pending", "delivered", "done", "refused", "expired"]
    reason: str | None
    issued: Instant
    expires: Instant
    delivered: Instant | None
    answered: TimeDocument | None

    @classmethod
    def of(cls, row: Row, *, now: int) -> Self:
        """A command, and what became of it by now."""
        state, reason = row["outcome"], row["reason"]
        if state is None and now >= row["expires"]:
            state, reason = "expired", "no answer came in time"
        elif state is None:
            state = "pending" if row["delivered"] is None else "delivered"
        given = {
            "arguments": orjson.loads(row["arguments"]),
            "state": state,
            "reason": reason,
            "answered": _span(row),
        }
        return cls.model_validate(dict(row) | given)


class StateDocument(BaseModel):
    """How a node should be set, and how it says that it is.

    Both map a place (a channel, a taxel, ``monitor:NAME``, or ``*`` for the whole node) to its
    settings; ``…_by`` is the command behind. ``settled`` says whether the node reports all
    that is desired.
    """

    node: str
    desired: dict[str, dict[str, float | str]]
    desired_at: Instant | None
    desired_by: int | None
    reported: dict[str, dict[str, float | str]] | None
    reported_at: TimeDocument | None
    reported_by: int | None
    settled: bool

    @classmethod
    def of(cls, node: str, row: Row | None) -> Self:
        """A node's settings; without a row, none are desired or reported."""
        known: Row = row if row is not None else defaultdict(lambda: None)
        desired = orjson.loads(known["desired"] or "{}")
        reported = None if known["reported"] is None else orjson.loads(known["reported"])
        return cls(
            node=node,
            desired=desired,
            desired_at=known["desired_at"],
            desired_by=known["desired_by"],
            reported=reported,
            reported_at=_span(known),
            reported_by=known["reported_by"],
            settled=is_settled(desired, reported),
        )


def _span(row: Row) -> TimeDocument | None:
    return None if row["t_lo"] is None else time_span(row["t_lo"], row["t_hi"])
