"""Steps of a unit: what it asks of the server, and what that reads, writes and publishes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from eskin_cloud.store.schema.tables import metadata

CENTRAL: Final = "central"
"""Stands for the advisory lock of central rows, as if it were a table."""
TABLES: Final = frozenset(metadata.tables)
_WORD: Final = re.compile(r"\w+")
_WRITTEN: Final = re.compile(r"\b(?:INSERT INTO|UPDATE|DELETE FROM|COPY) (\w+)")
_PARAMETER: Final = re.compile(r"%\(\w+\)s(?:::\w+)?")
_LONGEST: Final = 90
_NONE: Final = frozenset[str]()


@dataclass(frozen=True, slots=True)
class Step:
    """One call to the server.

    Attributes:
        unit: Who asks.
        text: What, in one line.
        reads: Tables that it reads, as they are committed.
        writes: Tables of which it changes or locks rows, until the end of its transaction.
        publishes: Tables whose changes and locks it ends.
    """

    unit: str
    text: str
    reads: frozenset[str] = _NONE
    writes: frozenset[str] = _NONE
    publishes: frozenset[str] = _NONE

    def __str__(self) -> str:
        return f"{self.unit}: {self.text}"

    @property
    def touches(self) -> frozenset[str]:
        """All its tables."""
        return self.reads | self.writes | self.publishes

    def depends_on(self, other: Step) -> bool:
        """Whether the order of two steps of different units may matter.

        What is written is seen by others from its commit on; until then it holds up those who
        write the same table.
        """
        return not (
            self.writes.isdisjoint(other.writes)
            and self.publishes.isdisjoint(other.reads | other.writes)
            and other.publishes.isdisjoint(self.reads | self.writes)
        )


def read_statement(unit: str, statement: str) -> Step:
    """A statement of a transaction that writes; each of its statements sees what is committed."""
    text = " ".join(statement.split())
    if "pg_advisory_xact_lock" in text:
        return Step(unit, "lock central rows", writes=frozenset({CENTRAL}))
    named = frozenset(_WORD.findall(text)) & TABLES
    written = named & frozenset(_WRITTEN.findall(text))
    if "FOR UPDATE" in text:
        written = named
    return Step(unit, _shorten(text), named - written, written)


def _shorten(text: str) -> str:
    """The verb, the tables and the beginning of the conditions."""
    text = _PARAMETER.sub("?", text)
    if text.startswith("SELECT") and " FROM " in text:
        text = " … ".join(("SELECT", text[text.index(" FROM ") + 1 :]))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
