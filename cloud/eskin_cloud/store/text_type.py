"""The column type of text, alike in SQLite and PostgreSQL."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from sqlalchemy import String
from sqlalchemy.types import TypeDecorator

if TYPE_CHECKING:
    from sqlalchemy import Dialect
    from sqlalchemy.types import TypeEngine


class Text(TypeDecorator[str]):
    """Text of limited length, ordered by code points.

    PostgreSQL accepts no NUL within text, and would order by locale.
    """

    impl = String
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """The type of a column."""
        length = cast("String", self.impl_instance).length
        collation = "C" if dialect.name == "postgresql" else None
        return dialect.type_descriptor(String(length, collation=collation))

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Replace NUL."""
        del dialect
        return None if value is None else storable(value)


def storable(text: str) -> str:
    """Text with Unicode's replacement character where there was a NUL."""
    return text.replace("\0", "\ufffd")
