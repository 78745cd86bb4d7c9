"""Questions to a store of either kind, in SQL that both understand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from eskin_cloud.store.location import reading_engine
from sqlalchemy import text

from tests.support.files import ask

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.store.location import StoreLocation


def ask_store(place: StoreLocation, query: str) -> Sequence[Sequence[Any]]:
    """Rows of an answer; none where there is no file yet."""
    if isinstance(place, Path):
        return ask(place, query)
    engine = reading_engine(place, readers=1)
    try:
        with engine.begin() as connection:
            return connection.execute(text(query)).all()
    finally:
        engine.dispose()


def write_place(place: StoreLocation) -> dict[str, object]:
    """A place as the section ``store`` of a cloud's settings names it."""
    if isinstance(place, Path):
        return {"path": place}
    return {"url": place.set(drivername="postgresql").render_as_string(hide_password=False)}
