"""Text as every store keeps it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from sqlalchemy import String
from sqlalchemy.types import TypeDecorator

if TYPE_CHECKING:
    from sqlalchemy import Dialect
    from sqlalchemy.types import TypeEngine


class Text(TypeDecorator[str]):
    """Text of at most so many characters, in the order of its code points.

    PostgreSQL knows no NUL within text, and sorts as people do unless it is told otherwise.
    """

    impl = String
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """The type of a column."""
        length = cast("String", self.impl_instance).length
        collation = "C" if dialect.name == "postgresql" else None
        return dialect.type_descriptor(String(length, collation=collation))

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Text on its way to the store."""
        del dialect
        return None if value is None else storable(value)


def storable(text: str) -> str:
    """Text with Unicode's replacement character where there was a NUL."""
    return text.replace("\0", "\ufffd")
