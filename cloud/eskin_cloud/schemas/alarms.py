"""Answers about monitors that are evaluated live, their alarms, and who receives those."""

from typing import Literal, Self

from pydantic import BaseModel
from sqlalchemy import RowMapping

from eskin_cloud.schemas.base import Instant, instant
from eskin_cloud.store.write.alarms import describe_alarm

VerdictName = Literal["certain", "possible", "impossible"]
TransitionKind = Literal["raised", "acknowledged", "escalated", "unsilenced", "cleared"]


class LiveVerdictDocument(BaseModel):
    """The latest verdict of a monitor that no later sample can change.

    ``missing`` is whether it could hold by samples alone that do not exist; ``until`` is up to when
    verdicts are known.
    """

    verdict: VerdictName
    missing: bool
    until: Instant


class MonitorDocument(BaseModel):
    """A monitor that the cloud evaluates live.

    ``latest`` is null before its first verdict, and where another cloud evaluates it. ``problem``
    is why it is not evaluated now. ``alarm`` is the id of its open alarm.
    """

    name: str
    formula: str
    node: str | None
    raise_on: Literal["never", "possible", "certain"]
    missing: bool
    severity: str
    clear_after_s: float
    escalate_after_s: float | None
    silenced_until: Instant | None
    created: Instant
    changed: Instant
    revision: int
    latest: LiveVerdictDocument | None
    problem: str | None
    alarm: int | None


class AlarmDocument(BaseModel):
    """An alarm: one for each episode.

    ``began`` and ``ended`` are when the formula began to hold, and became impossible, by the times
    of samples; all else is by the cloud's clock. ``ended`` is null of an alarm that was cleared as
    its monitor was changed or deleted.
    """

    id: int
    monitor: str
    revision: int
    formula: str
    severity: str
    verdict: Literal["possible", "certain"]
    state: Literal["raised", "cleared"]
    began: Instant
    ended: Instant | None
    raised: Instant
    acknowledged: Instant | None
    acknowledged_by: str | None
    escalated: Instant | None
    cleared: Instant | None

    @classmethod
    def of(cls, row: RowMapping) -> Self:
        """From its row."""
        return cls.model_validate(describe_alarm(row))


class TransitionDocument(BaseModel):
    """A change of an alarm; ``silenced`` is whether receivers are not given it."""

    number: int
    transition: TransitionKind
    time: Instant
    silenced: bool


class AlarmHistoryDocument(AlarmDocument):
    """An alarm with all of its changes."""

    transitions: list[TransitionDocument]


class ReceiverDocument(BaseModel):
    """Who is given alarms.

    All changes up to the number ``delivered`` were given. ``waiting`` is how many are left, and
    ``given_up`` how many it was not given after long failure.
    """

    name: str
    delivered: int
    waiting: int
    attempts: int
    failing_since: Instant | None
    next_attempt: Instant | None
    error: str | None
    given_up: int


def describe_receiver(row: RowMapping, waiting: int) -> ReceiverDocument:
    """One receiver."""
    return ReceiverDocument(
        name=row["name"],
        delivered=row["delivered"],
        waiting=waiting,
        attempts=row["attempts"],
        failing_since=instant(row["failing_since"]),
        next_attempt=instant(row["next_attempt"]),
        error=row["error"],
        given_up=row["given_up"],
    )


def describe_transition(row: RowMapping) -> TransitionDocument:
    """One change of an alarm."""
    return TransitionDocument(
        number=row["number"],
        transition=row["kind"],
        time=row["time"],
        silenced=bool(row["silenced"]),
    )
