"""What a part of the stack is to the bit flips: what it keeps on disk, and what it reads there."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

Answer: TypeAlias = "Mapping[str, Any]"
"""What the part's real code reads, by name. What damage hides has no name in it."""

NAMES: Final = (
    *("flash", "fleet", "spool", "keys", "identity", "authority", "broker"),
    *("store", "store_log", "frames"),
)
"""The parts, each a file in ``parts``."""


class Part(NamedTuple):
    """A part of the stack.

    Attributes:
        make: Fills an empty folder by the real code.
        read: Reads a copy of it by the real code, and may write to it.
        files: Which files bits are flipped in, as glob patterns below the folder.
        tables: Of databases, which tables with their indexes; empty for all.
    """

    make: Callable[[Path], None]
    read: Callable[[Path], Answer]
    files: tuple[str, ...]
    tables: tuple[str, ...] = ()


def load(name: str) -> Part:
    """The part of a name."""
    part: Part = import_module(f"tests.robustness.bitflips.parts.{name}").PART
    return part
