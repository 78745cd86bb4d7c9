"""How many examples a run draws of a property that takes long."""

from __future__ import annotations

from hypothesis import settings


def examples(count: int) -> int:
    """So many where others are drawn each time, as at night; a quarter of the same ones else."""
    return count if settings.get_current_profile_name() == "hunt" else -(-count // 4)
