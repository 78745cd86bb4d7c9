"""Names of many identities of one pattern."""

from __future__ import annotations

from typing import Final

_DIGITS: Final = 4


def numbered(stem: str, count: int) -> list[str]:
    """``stem-0001`` and so on: as many names, of equal length, in the order of the alphabet."""
    digits = max(_DIGITS, len(str(count)))
    return [f"{stem}-{number:0{digits}}" for number in range(1, count + 1)]
