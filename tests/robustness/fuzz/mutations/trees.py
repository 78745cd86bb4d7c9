"""Changing CBOR as a tree, so that what comes out is CBOR, too: also within byte strings."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

import cbor2

from eskin.wire.messages.wellformed import find_fault
from tests.robustness.fuzz.mutations.octets import mutate_octets

if TYPE_CHECKING:
    from random import Random

_TAG: Final = cbor2.CBORTag
_ATOMS: Final[tuple[Any, ...]] = (
    0, 1, -1, 2, 3, 5, 16, 17, 23, 24, 255, 256, 1000, 1001, 65535, 2**31, 2**32, 2**53 - 1, 2**53,
    2**62, 2**63 - 1, 2**63, 2**64 - 1, 2**64, 2**4000,
    -(2**53), -(2**63) + 1, -(2**63), -(2**64), -(2**70),
    0.0, -0.0, 0.5, 1.0, 1.5, 5e-324, 1.7e308, math.inf, -math.inf, math.nan,
    "", "*", "t01", "t01.capacitance", "T.x", "F", "set", "é" * 70, "\x00", "\u202e", "a" * 300,
    b"", b"\x00", b"\x00" * 12, b"\xff" * 16, b"\x00" * 32, b"\x80" * 64,
    None, True, False, cbor2.undefined, [], {}, [[]], {1: 1}, [0, 0], [0, 0, 0],
    datetime(2026, 1, 1, tzinfo=UTC),
    _TAG(0, "2026-13-01T00:00:00Z"), _TAG(0, "x"), _TAG(1, 1e300), _TAG(1, "x"), _TAG(2,
    b"\xff" * 9),
    _TAG(2, "x"), _TAG(3, b""), _TAG(4, [1, 2]), _TAG(4, [10**9, 1]), _TAG(4, 1), _TAG(5, [2, 3]),
    _TAG(5, [2**40, 3]), _TAG(16, []), _TAG(18, []), _TAG(25, 7), _TAG(28, [1]), _TAG(29, 0),
    _TAG(29, 99), _TAG(30, [1, 0]), _TAG(30, [1]), _TAG(35, "("), _TAG(35, "(a+)+$"), _TAG(35, 1),
    _TAG(36, "x"), _TAG(36, 1), _TAG(37, b"x"), _TAG(37, b"x" * 16), _TAG(69, b"\x00\x00"),
    _TAG(85, b"\x00" * 4), _TAG(86, b"\x00" * 8), _TAG(100, 10**12), _TAG(100, 1), _TAG(256, []),
    _TAG(258, [1, 1]), _TAG(258, [[]]), _TAG(260, b"\x01"), _TAG(260, b"\x7f\x00\x00\x01"),
    _TAG(261, {b"x": 99}), _TAG(261, {b"\x7f\x00\x00\x01": 8}), _TAG(1004, "x"), _TAG(43000, 1),
    _TAG(55799, 1), _TAG(2**63, 1),
)  # fmt: skip
_DEEPEST: Final = 12


def mutate_tree(data: bytes, random: Random) -> bytes:
    """Change a node or two of the tree; what is no CBOR is changed as bytes."""
    # A hostile tag may keep the library busy for hours.
    if random.random() < 0.15 or find_fault(data):
        return mutate_octets(data, random)
    try:
        tree = cbor2.loads(data)
        for _ in range(random.randint(1, 2)):
            tree = _changed(tree, random, _DEEPEST)
        return cbor2.dumps(tree)
    except (cbor2.CBORError, ValueError, TypeError):  # no text, or no key of a map
        return mutate_octets(data, random)


def read_input(data: bytes, parts: int) -> list[Any]:
    """An input that is an array of so many parts, the first hashable; of ``None`` if it is not."""
    nothing = [None] * parts
    if find_fault(data):
        return nothing
    try:
        found = cbor2.loads(data)
    except cbor2.CBORError:
        return nothing
    fits = isinstance(found, list) and len(found) == parts and isinstance(found[0], str)
    return found if fits else nothing


def _changed(tree: Any, random: Random, depth: int) -> Any:
    if depth == 0 or random.random() < 0.15:
        return _other(tree, random)
    if isinstance(tree, list):
        return _list(tree, random, depth)
    if isinstance(tree, dict):
        return _map(tree, random, depth)
    if isinstance(tree, cbor2.CBORTag):
        return _tag(tree, random, depth)
    return _octets(tree, random) if isinstance(tree, bytes) else _other(tree, random)


def _tag(tree: cbor2.CBORTag, random: Random, depth: int) -> cbor2.CBORTag:
    if random.random() < 0.1:
        return cbor2.CBORTag(random.choice((16, 18, 69, 85, 86, 2, 35)), tree.value)
    return cbor2.CBORTag(tree.tag, _changed(tree.value, random, depth - 1))


def _other(tree: Any, random: Random) -> Any:
    if isinstance(tree, int | float) and random.random() < 0.4:
        return tree + random.choice((-1, 1, 10**9) if isinstance(tree, int) else (-1.0, 0.5))
    if isinstance(tree, str) and random.random() < 0.4:
        place = random.randrange(len(tree) + 1)
        return tree[:place] + random.choice("az09._-*/+#\x00é") + tree[place + 1 :]
    if random.random() < 0.1:
        nest = tree
        for _ in range(random.choice((1, 5, 50, 400))):
            nest = [nest]
        return nest
    return random.choice(_ATOMS)


def _list(tree: list[Any], random: Random, depth: int) -> list[Any]:
    tree = list(tree)
    way = random.random()
    place = random.randrange(len(tree) + 1)
    if way < 0.12:
        tree.insert(place, random.choice(_ATOMS))
    elif way < 0.2:
        del tree[place : place + 1]
    elif way < 0.25:
        tree[place:place] = tree[place : place + 1] * random.choice((1, 3, 70))
    elif tree:
        place %= len(tree)
        tree[place] = _changed(tree[place], random, depth - 1)
    return tree


def _map(tree: dict[Any, Any], random: Random, depth: int) -> dict[Any, Any]:
    tree = dict(tree)
    way = random.random()
    if way < 0.1 or not tree:
        tree[random.choice((*range(20), -1, 34, "taxel", "rate", "x"))] = random.choice(_ATOMS)
    elif way < 0.2:
        del tree[random.choice(list(tree))]
    elif way < 0.25:
        key, other = random.choice(list(tree)), random.choice(list(tree))
        tree[key], tree[other] = tree[other], tree[key]
    else:
        key = random.choice(list(tree))
        tree[key] = _changed(tree[key], random, depth - 1)
    if random.random() < 0.9 and all(type(key) is int for key in tree):
        return dict(sorted(tree.items()))
    return tree


def _octets(tree: bytes, random: Random) -> bytes:
    if tree[:1] >= b"\x80" and random.random() < 0.6:
        return mutate_tree(tree, random)
    return mutate_octets(tree, random)
