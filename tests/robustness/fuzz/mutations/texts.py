"""Changing texts by words: TOML, JSON, CSV, requests, topics."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from tests.robustness.fuzz.mutations.octets import mutate_octets

if TYPE_CHECKING:
    from random import Random

_WORD: Final = re.compile(r"[A-Za-z_]+|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|\s+|.", re.DOTALL)
_ATOMS: Final = (
    "0", "1", "-1", "1.5", "-0.0", "1e9", "1e308", "1e400", "-1e400", "nan", "inf", "-inf",
    "1e-320",
    "65535", "65536", "2147483648", "9007199254740993", "9223372036854775807",
    "18446744073709551616",
    "9" * 400, "9" * 5000, "0x10", "1_000", "true", "false", "null", '""', '"x"', '"a.b"', "''",
    "'''",
    "[", "]", "[[", "]]", "{", "}", "[]", "{}", "[" * 3000, "=", ",", ".", ":", "/", "//", "\\",
    '"',
    "\n", "\r\n", "\r", "\t", "\x00", "\x1f", "\x7f", "é", "\u202e", "\U0001f600", "\u2028",
    "%00", "\\ud800", "http://[",
    "%2f", "%ff", "%", "+", "#", "$", "*", "..", "../..", "&", "?", ";", " ", "a" * 300,
    "2026-01-31T12:00:00Z", "1677-01-01T00:00:00Z", "2263-01-01T00:00:00.123456789Z",
    "9999-12-31T23:59:59Z",
    "0000-01-01T00:00:00Z", "0001-01-01T00:00:00+23:59", "2026-02-30T00:00:00Z",
    "2026-01-31T24:00:00Z",
    "2026-06-30T23:59:60Z", "1979-05-27", "07:32:00", "\N{ARABIC-INDIC DIGIT ONE}",
    "\N{SUPERSCRIPT TWO}",
)  # fmt: skip


def mutate_text(data: bytes, random: Random) -> bytes:
    """Change a word or more; now and then the bytes behind them."""
    if random.random() < 0.1:
        return mutate_octets(data, random)
    words = _WORD.findall(data.decode("utf-8", "surrogateescape"))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        _change(words, random)
    return "".join(words).encode("utf-8", "surrogateescape")


def _change(words: list[str], random: Random) -> None:
    place = random.randrange(len(words) + 1)
    way = random.random()
    if way < 0.45 and words:
        words[place % len(words)] = random.choice(_ATOMS)
    elif way < 0.6:
        words.insert(place, random.choice(_ATOMS))
    elif way < 0.75:
        del words[place : place + random.choice((1, 1, 2, 8))]
    elif way < 0.85:
        words[place:place] = words[place : place + random.choice((1, 4, 20))]
    elif words:
        other = random.randrange(len(words))
        place %= len(words)
        words[place], words[other] = words[other], words[place]
