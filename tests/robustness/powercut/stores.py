"""All that must outlive a power cut, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

from tests.robustness.powercut import flash, spool, store

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from tests.robustness.powercut.journal import Marks


class Subject(NamedTuple):
    """A store: what happens to it, and what must hold when the power has failed meanwhile.

    Attributes:
        work: Works in a folder, and prints what it does.
        check: Opens what a cut has left, given what was stated before; raises AssertionError.
    """

    work: Callable[[Path, random.Random, Marks], None]
    check: Callable[[Path, list[list[Any]]], None]


STORES: Final[Mapping[str, Subject]] = {
    "flash": Subject(flash.work, flash.check),
    "spool": Subject(spool.work, spool.check),
    "store": Subject(store.work, store.check),
}
