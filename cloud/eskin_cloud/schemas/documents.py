"""The shapes of answers, for the OpenAPI description; answers themselves are written by shapes."""

from typing import Annotated, Final, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

T = TypeVar("T")

TIME: Final = "RFC 3339, or integer nanoseconds since 1970"
"""How a question may write a time."""
_YEAR: Final = "(?:16(?:7[89]|[89][0-9])|1[7-9][0-9]{2}|2[01][0-9]{2}|22(?:[0-5][0-9]|6[0-2]))"
_DAY: Final = "(?:0[1-9]|1[0-2])-(?:0[1-9]|[12][0-9]|3[01])"
_MINUTE: Final = "(?:[01][0-9]|2[0-3]):[0-5][0-9]"
_RFC3339: Final = rf"{_YEAR}-{_DAY}T{_MINUTE}:[0-5][0-9](?:\.[0-9]{{1,9}})?(?:Z|[+-]{_MINUTE})"
_NANOSECONDS: Final = "-?(?:[0-9]{1,18}|[0-8][0-9]{18}|9[01][0-9]{17})"
# The description tells it and `eskin.wire.timestamp` checks it, whose refusals say what to do.
Time = Annotated[
    str,
    Field(max_length=100, json_schema_extra={"pattern": f"^(?:{_RFC3339}|{_NANOSECONDS})$"}),
]
"""A time in a question."""
Place = Annotated[str, Field(json_schema_extra={"pattern": "^[^/]+/."})]
"""A channel in a question, with its node."""
Moment = Annotated[
    str,
    Field(
        pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{9}Z$",
        examples=["2026-01-31T12:00:00.000000000Z"],
    ),
]


class NoQuery(BaseModel):
    """No parameters."""

    model_config = ConfigDict(extra="forbid")


class IntervalDocument(BaseModel):
    """An interval; a side that is null is unbounded."""

    lo: float | None
    hi: float | None


class TimeDocument(BaseModel):
    """An enclosure of a moment or a stretch of time."""

    lo: Moment
    hi: Moment


class OutboxDocument(BaseModel):
    """What waits in a node's flash."""

    messages: int
    bytes: int
    capacity_bytes: int


class EnergyDocument(BaseModel):
    """What a node knows of its energy: stored in J, charge from 0 (brown-out) to 1 (full)."""

    stored: IntervalDocument
    charge: IntervalDocument
    self_sustaining: Literal["certain", "possible", "impossible"]
    shedding: Literal["none", "adaptive", "peaks", "sleep"]


class FaultDocument(BaseModel):
    """A taxel that may be broken, by the latest window of its node's self-test."""

    taxel: str
    dead: Literal["certain", "possible", "impossible"]
    stuck: Literal["certain", "possible", "impossible"]


class LagDocument(BaseModel):
    """How long after its last sample the latest block was stored: an enclosure, by our clock."""

    lo_ns: int
    hi_ns: int


class OffsetDocument(BaseModel):
    """The middle of what the clock states minus the true time, ns; ``null``: not bounded."""

    lo_ns: int | None
    hi_ns: int | None


class ClockDocument(BaseModel):
    """Whether the node's statement of UTC in its latest status holds, by what messages prove."""

    verdict: Literal["certain", "possible", "impossible"]
    offset: OffsetDocument
    references_agree: bool


class MissingRangeDocument(BaseModel):
    """Numbers of messages of one boot, the last one included."""

    boot: int
    first: int
    last: int


class MissingDocument(BaseModel):
    """Messages that the node made and that are stored nowhere, though no gap names them.

    ``ranges`` are the latest ones, at most 16.
    """

    messages: int
    since: Moment
    ranges: list[MissingRangeDocument]


class NodeDocument(BaseModel):
    """A node."""

    id: str
    health: Literal["online", "late", "offline"]
    last_seen: Moment
    boot: int
    sequence: int | None
    profile: str | None
    description: str | None
    uptime_ns: int | None
    outbox: OutboxDocument | None
    gaps: int
    energy: EnergyDocument | None
    faults: list[FaultDocument] | None
    channels: int
    lag: LagDocument | None
    clock: ClockDocument | None
    missing: MissingDocument | None


class TaxelDocument(BaseModel):
    """Where a taxel sits: x and y of its centre in m, on a flat map of the skin."""

    id: str
    position_m: tuple[float, float]


class RemovedDocument(BaseModel):
    """What retention or erasure removed of a channel: how many messages, all before when."""

    messages: int
    before: Moment


class ChannelDocument(BaseModel):
    """A channel; ``bytes`` is what its blocks take, without indices and hulls; of sealed: null."""

    id: str
    taxel: str
    quantity: str
    unit: str
    coverage: float
    dt: int
    blocks: int | None
    samples: int | None
    bytes: int | None
    first: Moment | None
    last: Moment | None
    bounds: IntervalDocument | None
    biometric: bool
    removed: RemovedDocument | None


class EventDocument(BaseModel):
    """An event."""

    id: str
    node: str
    channel: str | None
    kind: Literal["peak", "gap", "status", "command", "conflict"]
    verdict: Literal["certain", "possible"] | None
    time: TimeDocument
    height: IntervalDocument | None
    prominence: IntervalDocument | None
    count: IntervalDocument | None
    unit: str | None
    coverage: float | None
    boot: int
    detail: str | None


class CommandDocument(BaseModel):
    """A command.

    ``expired`` without an answer may still turn into what the node says: it may have done it in
    time, and its word is on its way.
    """

    id: int
    node: str
    name: Literal["calibrate", "set", "reset"]
    arguments: dict[str, float | str]
    state: Literal["pending", "delivered", "done", "refused", "expired"]
    reason: str | None
    issued: Moment
    expires: Moment
    delivered: Moment | None
    answered: TimeDocument | None


class StateDocument(BaseModel):
    """How a node should be set, and how it says that it is.

    Both map a place (a channel, a taxel, or ``*`` for the whole node) to its settings; ``…_by`` is
    the command behind. ``settled`` says whether the node reports all that is desired.
    """

    node: str
    desired: dict[str, dict[str, float | str]]
    desired_at: Moment | None
    desired_by: int | None
    reported: dict[str, dict[str, float | str]] | None
    reported_at: TimeDocument | None
    reported_by: int | None
    settled: bool


class TokenDocument(BaseModel):
    """A token, without its secret."""

    id: str
    name: str
    scopes: list[Literal["read", "operate", "admin", "biometric"]]
    state: Literal["good", "expired", "revoked"]
    created: Moment
    expires: Moment | None
    revoked: Moment | None


class SessionDocument(BaseModel):
    """A session that is good, without its secret; ``name`` is its token's, or ``login link``."""

    id: str
    name: str
    scopes: list[Literal["read", "operate", "admin", "biometric"]]
    expires: Moment


class NewTokenDocument(BaseModel):
    """A token that was just made; it is told only here."""

    id: str
    token: str


class DeedDocument(BaseModel):
    """What somebody did."""

    id: int
    time: Moment
    actor: str
    address: str
    action: str
    target: str
    detail: str
    digest: str


class PageDocument(BaseModel, Generic[T]):
    """A page of a list."""

    items: list[T]
    next: str | None


class ResultDocument(BaseModel):
    """What became of one message."""

    result: Literal["stored", "duplicate", "rejected", "unknown_node"]
    reason: str | None


class IngestDocument(BaseModel):
    """What became of a batch, in its order."""

    items: list[ResultDocument]
    watched: dict[str, float] = Field(
        default={}, description="senders at which somebody looks, and for how many seconds from now"
    )


class ConfirmedItem(BaseModel):
    """Numbers of a boot that are not stored here; the last one included."""

    node: str
    boot: int
    first: int
    last: int


class ConfirmedDocument(BaseModel):
    """What a gateway was told is stored, and is not; nodes whose certificates are needed first."""

    items: list[ConfirmedItem]
    unknown_nodes: list[str]


class SubjectDocument(BaseModel):
    """A subject, by pseudonym: the nodes it wore, the sealed messages held, when it was erased."""

    id: str
    site: str
    nodes: list[str]
    messages: int
    erased: Moment | None


class NoticeItem(BaseModel):
    """What became of a subject's key here."""

    id: str
    result: Literal["kept", "declined", "erased", "conflict", "unknown_node"]


class NoticeDocument(BaseModel):
    """The answer to a notice of subjects."""

    items: list[NoticeItem]
