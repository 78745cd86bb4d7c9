"""What a token or a session allows."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class Scope(StrEnum):
    """What its holder may do."""

    READ = "read"
    OPERATE = "operate"
    ADMIN = "admin"
    BIOMETRIC = "biometric"


def write_scopes(scopes: Iterable[Scope]) -> str:
    """Write scopes as the store keeps them."""
    return " ".join(sorted(set(scopes)))


def read_scopes(text: str) -> frozenset[Scope]:
    """Read scopes as the store keeps them."""
    return frozenset(Scope(word) for word in text.split())
