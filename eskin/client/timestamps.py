"""Moments as questions to the cloud write them."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Final

from eskin.errors import QueryError

_EPOCH: Final = datetime.fromisoformat("1970-01-01T00:00:00+00:00")

Moment = datetime | int | str
"""A moment: with a time zone, as UTC ns since 1970, or in RFC 3339."""


def written_moments(**moments: Moment | None) -> dict[str, str]:
    """Parameters of a question, by name; what is ``None`` is left out.

    Raises:
        QueryError: A moment has no time zone.
    """
    given = {name: moment for name, moment in moments.items() if moment is not None}
    return {name: _written(name, moment) for name, moment in given.items()}


def _written(parameter: str, moment: Moment) -> str:
    if not isinstance(moment, datetime):
        return str(moment)
    if moment.tzinfo is None:
        raise QueryError(parameter, f"{moment} has no time zone; give it one, such as UTC")
    return str((moment - _EPOCH) // timedelta(microseconds=1) * 1000)
