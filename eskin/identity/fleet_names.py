"""Names of many identities of one pattern."""

from __future__ import annotations

from typing import Final

_DIGITS: Final = 4


def numbered(stem: str, count: int) -> list[str]:
    """``stem-0001`` and so on: as many names, of equal length, in the order of the alphabet."""
    digits = max(_DIGITS, len(str(count)))
    return [f"{stem}-{number:0{digits}}" for number in range(1, count + 1)]


def is_numbered(name: str, stem: str, count: int) -> bool:
    """Whether a name is one of those that `numbered` gives."""
    number = name.removeprefix(f"{stem}-")
    digits = max(_DIGITS, len(str(count)))
    plain = len(number) == digits and number.isascii() and number.isdigit()
    return plain and name != number and 1 <= int(number) <= count
