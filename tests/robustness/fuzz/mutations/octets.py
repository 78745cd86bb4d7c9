"""Changing bytes that may be anything."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

_WORDS: Final = (
    b"\x00", b"\xff", b"\x7f", b"\x80", b"\x00" * 8, b"\xff" * 8,
    b"\x7f" + b"\xff" * 7, b"\x80" + b"\x00" * 7, b"\x00\x00\xc0\x7f",
    b"\x00\x00\x00\x00\x00\x00\xf0\x7f",
)  # fmt: skip
_WRITTEN: Final = re.compile(rb"[^\0]")


def mutate_octets(data: bytes, random: Random) -> bytes:
    """Flip, set, insert, repeat, overwrite, remove or cut off, once to four times."""
    for _ in range(random.randint(1, 4)):
        data = random.choice(_WAYS)(data, random)
    return data


def _flip(data: bytes, random: Random) -> bytes:
    if not data:
        return data
    place = random.randrange(len(data))
    return data[:place] + bytes([data[place] ^ 1 << random.randrange(8)]) + data[place + 1 :]


def _set(data: bytes, random: Random) -> bytes:
    place = random.randrange(len(data) + 1)
    return data[:place] + random.randbytes(1) + data[place + 1 :]


def _insert(data: bytes, random: Random) -> bytes:
    place = random.randrange(len(data) + 1)
    return data[:place] + random.choice(_WORDS) + data[place:]


def _overwrite(data: bytes, random: Random) -> bytes:
    place, word = random.randrange(len(data) + 1), random.choice(_WORDS)
    return data[:place] + word + data[place + len(word) :]


def _repeat(data: bytes, random: Random) -> bytes:
    first, last = _slice(data, random)
    return data[:last] + data[first:last] + data[last:]


def _remove(data: bytes, random: Random) -> bytes:
    first, last = _slice(data, random)
    return data[:first] + data[last:]


def _cut(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _slice(data: bytes, random: Random) -> tuple[int, int]:
    first = random.randrange(len(data) + 1)
    return first, min(len(data), first + random.randint(1, 32))


_WAYS: Final[tuple[Callable[[bytes, Random], bytes], ...]] = (
    _flip,
    _set,
    _insert,
    _overwrite,
    _repeat,
    _remove,
    _cut,
)


def mutate_image(data: bytes, random: Random) -> bytes:
    """Damage a file where something is written, as a worn disk does: its length stays."""
    image = bytearray(data)
    for _ in range(random.randint(1, 6)):
        place = random.randrange(len(image) or 1)
        if written := _WRITTEN.search(image, place):
            word = random.choice((random.randbytes(1), *_WORDS))
            near = max(0, written.start() + random.randint(-2, 2))
            image[near : near + len(word)] = word
    return bytes(image[: len(data)])
