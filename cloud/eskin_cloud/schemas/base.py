"""What all answers are made of: times, intervals, pages.

An answer has one description, its class. What lists repeat thousands of times is a `TypedDict`:
mypy checks what is returned, and orjson writes it without a model for each row (1000 events take
3 ms so, and 24 ms as models). All else is a Pydantic model, which FastAPI writes.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Annotated, Any, Final, Generic, TypeAlias, TypeVar

import orjson
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from sqlalchemy import RowMapping
from typing_extensions import TypedDict

from eskin.wire.timestamp import SECOND, format_timestamp

T = TypeVar("T")
Json: TypeAlias = dict[str, Any]
Row: TypeAlias = RowMapping | dict[str, Any]

TIME: Final = "RFC 3339, or integer nanoseconds since 1970"
"""How a question may write a time."""
_YEAR: Final = "(?:16(?:7[89]|[89][0-9])|1[7-9][0-9]{2}|2[01][0-9]{2}|22(?:[0-5][0-9]|6[0-2]))"
_DAY: Final = "(?:0[1-9]|1[0-2])-(?:0[1-9]|[12][0-9]|3[01])"
_MINUTE: Final = "(?:[01][0-9]|2[0-3]):[0-5][0-9]"
_RFC3339: Final = rf"{_YEAR}-{_DAY}T{_MINUTE}:[0-5][0-9](?:\.[0-9]{{1,9}})?(?:Z|[+-]{_MINUTE})"
_NANOSECONDS: Final = "-?(?:[0-9]{1,18}|[0-8][0-9]{18}|9[01][0-9]{17})"
# The description states it; `eskin.wire.timestamp` checks it, and its errors say what to do.
Time = Annotated[
    str,
    Field(max_length=100, json_schema_extra={"pattern": f"^(?:{_RFC3339}|{_NANOSECONDS})$"}),
]
"""A time in a question."""
Place = Annotated[str, Field(json_schema_extra={"pattern": "^[^/]+/."})]
"""A channel in a question, with its node."""


def _format(instant: object) -> object:
    return format_timestamp(instant) if isinstance(instant, int) else instant


Instant = Annotated[
    str,
    BeforeValidator(_format),
    Field(
        pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{9}Z$",
        examples=["2026-01-31T12:00:00.000000000Z"],
    ),
]
"""A time in an answer; a model takes UTC ns, too."""


class NoQuery(BaseModel):
    """No parameters."""

    model_config = ConfigDict(extra="forbid")


class PageQuery(BaseModel):
    """Which page of a list."""

    model_config = ConfigDict(extra="forbid")

    limit: int = Field(default=100, ge=1, le=1000, description="items at once")
    cursor: str | None = Field(default=None, max_length=1000, description="the value of `next`")


class IntervalDocument(TypedDict):
    """An interval; a side that is null is unbounded."""

    lo: float | None
    hi: float | None


class TimeDocument(TypedDict):
    """An enclosure of an instant or a stretch of time."""

    lo: Instant
    hi: Instant


class CountDocument(TypedDict):
    """How many, at least and at most."""

    lo: int
    hi: int


class LagDocument(TypedDict):
    """How long after its last sample the latest frame was stored: an enclosure, by our clock."""

    lo_ns: int
    hi_ns: int


class PageDocument(BaseModel, Generic[T]):
    """A page of a list."""

    items: list[T]
    next: str | None


def dump(value: object) -> bytes:
    """Write JSON; floats as their shortest exact text, infinite ones as ``null``."""
    return orjson.dumps(value, option=orjson.OPT_SERIALIZE_NUMPY)


def page(items: Sequence[object], following: str | None) -> Json:
    """A page of a long list."""
    return {"items": items, "next": following}


def interval(lo: float | None, hi: float | None) -> IntervalDocument | None:
    """An interval; ``None`` where both sides are missing."""
    return None if lo is None and hi is None else {"lo": lo, "hi": hi}


def time_span(lo: int, hi: int) -> TimeDocument:
    """An enclosure of an instant, or a stretch of time, of UTC ns."""
    return {"lo": format_timestamp(lo), "hi": format_timestamp(hi)}


def instant(nanoseconds: int | None) -> str | None:
    """A time, if there is one."""
    return None if nanoseconds is None else format_timestamp(nanoseconds)


def whole_minute(nanoseconds: int) -> int:
    """A time as what is sealed may be known by: its minute (docs/privacy.md)."""
    return nanoseconds - nanoseconds % (60 * SECOND)


def lag(row: Row) -> LagDocument | None:
    """How long after its last sample the latest frame was stored."""
    return None if row["lag_lo"] is None else {"lo_ns": row["lag_lo"], "hi_ns": row["lag_hi"]}


def seconds(nanoseconds: int, side: float) -> float:
    """As a float on its side of the exact value."""
    exact = Fraction(nanoseconds, 10**9)
    nearest = float(exact)
    wrong = Fraction(nearest) > exact if side < 0 else Fraction(nearest) < exact
    return math.nextafter(nearest, side) if wrong else nearest
