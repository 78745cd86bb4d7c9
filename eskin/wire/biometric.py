"""Which channels are biometric."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

BIOMETRIC: Final = frozenset({"bioelectric"})
"""Biometric quantities."""
MARK: Final = "bio-"
"""Prefix of the ids of taxels that are biometric whatever they measure."""


@lru_cache(4096)
def is_biometric(channel: str) -> bool:
    """Whether a channel is biometric: never public, and encrypted at rest.

    Its name alone says so: it comes with every message, so that no two tiers can disagree.

    Args:
        channel: ``{taxel}.{quantity}``.
    """
    return channel.startswith(MARK) or channel.rpartition(".")[2] in BIOMETRIC
