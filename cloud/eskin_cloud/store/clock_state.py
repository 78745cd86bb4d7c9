"""What the store knows of the time, while no cloud runs: up to when a clock was believed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import BigInteger, Column, Table, select, text

from eskin_cloud.store.schema.tables import metadata
from eskin_cloud.store.schema.text_type import Text

if TYPE_CHECKING:
    from sqlalchemy import Connection

clock: Final = Table(
    "clock",
    metadata,
    Column("name", Text(16), primary_key=True),
    Column("believed", BigInteger, nullable=False),
    Column("ahead", BigInteger, nullable=False),
    Column("doubted", BigInteger, nullable=False),
)
"""One row: a `Reading`."""

_KEEP: Final = text(
    "INSERT INTO clock (name, believed, ahead, doubted) "
    "VALUES ('clock', :believed, :ahead, :doubted) ON CONFLICT (name) DO UPDATE "
    "SET believed = excluded.believed, ahead = excluded.ahead, doubted = excluded.doubted"
)


class Reading(NamedTuple):
    """The time that a cloud went by.

    Attributes:
        believed: UTC ns.
        ahead: By how much (ns) its clock told a later time; 0: what it told was believed.
        doubted: For how long (ns) that was not believed.
    """

    believed: int
    ahead: int = 0
    doubted: int = 0


def last_reading(connection: Connection) -> Reading | None:
    """What a cloud kept last; ``None`` if none ever did."""
    row = connection.execute(select(clock.c.believed, clock.c.ahead, clock.c.doubted)).one_or_none()
    return None if row is None else Reading(*row)


def keep_reading(connection: Connection, reading: Reading) -> None:
    """Keep what a cloud goes by."""
    connection.execute(_KEEP, reading._asdict())
