"""The time by which retention last ran; it survives a restart of the cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import select, text

from eskin_cloud.store.schema.tables import clock_state

if TYPE_CHECKING:
    from sqlalchemy import Connection

_SAVE: Final = text(
    "INSERT INTO clock_state (name, believed, ahead, doubted) "
    "VALUES ('clock', :believed, :ahead, :doubted) ON CONFLICT (name) DO UPDATE "
    "SET believed = excluded.believed, ahead = excluded.ahead, doubted = excluded.doubted"
)


class ClockReading(NamedTuple):
    """The state of a cloud's clock guard.

    Attributes:
        believed: The accepted time, UTC ns.
        ahead: How far the clock was ahead of it, ns; 0 if the clock was accepted.
        doubted: For how long the clock was not accepted, ns.
    """

    believed: int
    ahead: int = 0
    doubted: int = 0


def load_clock(connection: Connection) -> ClockReading | None:
    """The last saved state; ``None`` if there is none."""
    row = connection.execute(
        select(clock_state.c.believed, clock_state.c.ahead, clock_state.c.doubted)
    ).one_or_none()
    return None if row is None else ClockReading(*row)


def save_clock(connection: Connection, reading: ClockReading) -> None:
    """Save the state."""
    connection.execute(_SAVE, reading._asdict())
