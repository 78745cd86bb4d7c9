"""What a fuzz target is: seeds, a way to change them, and what must hold of every input."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Final

from tests.robustness.fuzz.current import LONGEST

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

NAMES: Final = (
    "wire",
    "encodings",
    "frame",
    "envelope",
    "signature",
    "gateway_status",
    "ingest",
    "deliveries",
    "intake",
    "certificates",
    "settings",
    "environment",
    "scenario",
    "recording",
    "queries",
    "questions",
    "requests",
    "enrolment",
    "flash",
    "spool",
)
"""The targets, each a file in ``targets``."""


@dataclass(frozen=True, slots=True)
class Target:
    """One way in.

    Attributes:
        seeds: Good inputs.
        mutate: Changes an input, knowing how it is made.
        check: The oracle: raises whatever breaks it, and nothing else.
        stack: What it needs until its end.
        longest: Bytes of an input. libFuzzer keeps what grows, so that a target whose cost grows
            with its input would spend its time on few of them.
    """

    seeds: tuple[bytes, ...]
    mutate: Callable[[bytes, Random], bytes]
    check: Callable[[bytes], None]
    stack: ExitStack = field(default_factory=ExitStack)
    longest: int = LONGEST


def load(name: str, folder: Path) -> Target:
    """Make a target that keeps its files in a folder."""
    target: Target = import_module(f"tests.robustness.fuzz.targets.{name}").make(folder)
    return target
