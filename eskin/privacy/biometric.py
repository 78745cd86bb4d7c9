"""Which channels tell of a person."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

BIOMETRIC: Final = frozenset({"bioelectric"})
"""Quantities that tell of a person."""
MARK: Final = "bio-"
"""What the id of a taxel begins with that tells of a person, whatever it measures."""


@lru_cache(4096)
def is_biometric(channel: str) -> bool:
    """Whether what a channel measures tells of a person: it is public nowhere, and sealed at rest.

    Its name alone says so: it comes with every message, so that no two tiers can disagree.

    Args:
        channel: ``{taxel}.{quantity}``.
    """
    return channel.startswith(MARK) or channel.rpartition(".")[2] in BIOMETRIC
