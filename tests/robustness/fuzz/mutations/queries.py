"""Changing a request's target by its parameters, so that what comes out is mostly understood."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qsl, urlencode

from eskin_cloud.query.opaque_ids import OpaqueIds

from eskin.monitor.predicted_quantities import DEFAULTS, MODELS, UNITS
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START

if TYPE_CHECKING:
    from random import Random

    Pairs = list[tuple[str, str]]

IDS: Final = OpaqueIds(bytes(32))
"""By which the cloud that is asked encrypts cursors, so that they may hold anything."""
OTHER: Final = "t02.capacitance"
"""A second channel of the node."""
_NAMES: Final = (
    "start", "end", "points", "above", "below", "at_least", "at_most", "outside", "limit", "cursor",
    "other", "state", "model", "parameter", "origin", "channel", "node", "kind", "verdict", "order",
)  # fmt: skip
_NUMBERS: Final = (
    "0", "1", "2", "3", "7", "100", "1000", "20000", "20001", "-1", "1.5", "1.25", "-0.0", "1e-12",
    "5e-324", "1.7e308", "-1.7e308", "1e309", "nan", "inf", "9" * 40, "9007199254740993", "1e-400",
    "9223372036854775807", "9223372036854775808", "-9223372036854775808", "1_0", "",
    "\N{ARABIC-INDIC DIGIT ONE}",
)  # fmt: skip
_INSTANTS: Final = (
    *(str(START + k * DT) for k in (-10**6, -1, 0, 1, 49, 50, 99, 100, 3000, 10**6, 10**9)),
    *(str(START + k) for k in (-1, 1)),
    "2027-01-15T08:00:00Z", "2027-01-15T08:00:00.123456789+01:00", "0", "-1",
    "0001-01-01T00:00:00Z", "1677-09-21T00:12:43.145224193Z", "2262-04-11T23:47:16.854775807Z",
    "9999-12-31T23:59:59.999999999Z", "now",
)  # fmt: skip
_WORDS: Final = (
    "true", "false", "above", "below", "peak", "gap", "status", "command", "certain", "possible",
    "asc", "desc", NODE, CHANNEL, f"{NODE}/{CHANNEL}", f"{NODE}/{OTHER}", f"{NODE}/nowhere", "/",
    "unknown/t01.x", *MODELS, "a" * 300,
    IDS.write(START, START + 3000 * DT), IDS.write(START + 50 * DT, START),
    IDS.write(START, START + 10**9, START), IDS.write(-(2**63), 2**63 - 1),
    IDS.write(5), IDS.write_name(NODE), IDS.write(0, 0, 0, 0), IDS.write(START, START, 0, 0, 0, 0),
)  # fmt: skip
_POOLS: Final = (_NUMBERS, _INSTANTS, _WORDS)


def mutate_query(data: bytes, random: Random) -> bytes:
    """Change, add or remove a parameter, once to three times; now and then any word of it."""
    if random.random() < 0.15:
        return mutate_text(data, random)
    target, newline, rest = data.decode("utf-8", "replace").partition("\n")
    path, _, query = target.partition("?")
    pairs = parse_qsl(query, keep_blank_values=True)
    for _ in range(random.randint(1, 3)):
        _change(pairs, random)
    return f"{path}?{urlencode(pairs)}{newline}{rest}".encode("utf-8", "replace")


def _change(pairs: Pairs, random: Random) -> None:
    way = random.random()
    if way < 0.25 or not pairs:
        pairs.insert(random.randint(0, len(pairs)), (random.choice(_NAMES), _value(random)))
    elif way < 0.4:
        del pairs[random.randrange(len(pairs))]
    else:
        place = random.randrange(len(pairs))
        pairs[place] = pairs[place][0], _value(random)


def _value(random: Random) -> str:
    if random.random() < 0.15:
        return _parameter(random)
    return random.choice(random.choice(_POOLS))


def _parameter(random: Random) -> str:
    """A model's parameter, as it usually is, or of any bounds."""
    usual = random.choice(list(DEFAULTS.values()))
    name = random.choice([*usual, *UNITS])
    if name in usual and random.random() < 0.6:
        return ":".join([name, *map(str, usual[name])])
    return ":".join([name, *random.choices(_NUMBERS, k=random.randint(0, 3))])
