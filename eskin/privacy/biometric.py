"""Which channels tell of a person."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

BIOMETRIC: Final = frozenset({"bioelectric"})
"""Quantities that tell of a person."""


@lru_cache(4096)
def is_biometric(channel: str) -> bool:
    """Whether what a channel measures tells of a person: it is public nowhere, and sealed at rest.

    Args:
        channel: ``{taxel}.{quantity}``.
    """
    return channel.rpartition(".")[2] in BIOMETRIC
