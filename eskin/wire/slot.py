"""Slots of nodes: what leads each key of a node's tables, so that writers share the store."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

T = TypeVar("T")
U = TypeVar("U")

SLOTS: Final = 64


@lru_cache(16_384)
def slot_of(node: str) -> int:
    """The slot of a node, from 0 to 63: the first 8 bytes of its name's SHA-256, modulo 64."""
    return int.from_bytes(hashlib.sha256(node.encode()).digest()[:8]) % SLOTS


def key_of(node: str) -> tuple[int, str]:
    """What the key of each row of a node begins with: its slot, and its name."""
    return slot_of(node), node


def even_groups(number: int) -> tuple[int, ...]:
    """The group of each slot, of so many groups of neighbouring slots."""
    return tuple(slot * number // SLOTS for slot in range(SLOTS))


@dataclass(frozen=True, slots=True)
class SlotShare(Generic[T]):
    """Items of the nodes of one group of slots, which one transaction may write.

    Attributes:
        slots: The slots of their nodes.
        numbers: Their places among all items.
        items: The items.
    """

    slots: set[int] = field(default_factory=set)
    numbers: list[int] = field(default_factory=list)
    items: list[T] = field(default_factory=list)


def share_out(
    items: Iterable[T], node_of: Callable[[T], str], groups: Sequence[int]
) -> list[SlotShare[T]]:
    """Share items out by the groups of their nodes' slots.

    Args:
        items: The items.
        node_of: Gives an item's node.
        groups: The group of each slot.
    """
    shares: dict[int, SlotShare[T]] = {}
    for number, item in enumerate(items):
        slot = slot_of(node_of(item))
        own = shares.setdefault(groups[slot], SlotShare())
        own.slots.add(slot)
        own.numbers.append(number)
        own.items.append(item)
    return list(shares.values())


def in_order(shares: Iterable[SlotShare[T]], results: Iterable[Sequence[U]]) -> list[U]:
    """The results of all items, in the items' order.

    Args:
        shares: As `share_out` gives them.
        results: Those of each share, in the order of its items.
    """
    found: dict[int, U] = {}
    for each, own in zip(shares, results, strict=True):
        found.update(zip(each.numbers, own, strict=True))
    return [found[number] for number in sorted(found)]


def slot_of_cursor(cursor: int) -> int:
    """The slot of a cursor, which is 64 times a number within the slot, plus the slot."""
    return cursor % SLOTS
