"""What became of a flipped bit: stated, without effect, or broken."""

from __future__ import annotations

import logging
import shutil
import tempfile
import traceback
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import EskinError
from tests.robustness.bitflips.flip import draw
from tests.robustness.bitflips.part import load

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tests.robustness.bitflips.flip import Flip
    from tests.robustness.bitflips.part import Answer, Part

_FAST: Final = Path("/dev/shm")  # noqa: S108 - a fresh folder in it
_ROOMS: Final = ("eskin", "eskin_cloud", "eskin_gateway", "eskin_sensor_node", "eskin_ca")


class Outcome(StrEnum):
    """Of one flip."""

    DETECTED = "detected"
    HARMLESS = "harmless"
    BROKEN = "broken"


class Verdict(NamedTuple):
    """A flip and what became of it.

    Attributes:
        flip: Which.
        outcome: What became of it.
        why: The error or the words of the log; or what is broken.
    """

    flip: Flip
    outcome: Outcome
    why: str


class _Words(logging.Handler):
    """Keeps what is logged as a warning or an error."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())
        if (
            record.exc_info
            and record.exc_info[0]
            and not issubclass(record.exc_info[0], EskinError)
        ):
            self.said.append(f"TRACEBACK {record.exc_info[1]!r}")


@contextmanager
def listening() -> Iterator[list[str]]:
    """All that the stack logs meanwhile, from a warning on."""
    words = _Words()
    loggers = [logging.getLogger(name) for name in _ROOMS]
    before = [(each.propagate, each.level) for each in loggers]
    for each in loggers:
        each.addHandler(words)
        each.propagate = False
        each.setLevel(logging.WARNING)
    try:
        yield words.said
    finally:
        for each, (propagate, level) in zip(loggers, before, strict=True):
            each.removeHandler(words)
            each.propagate = propagate
            each.setLevel(level)


def attack(name: str, *, flips: int, seed: int, tables: Sequence[str] = ()) -> Iterator[Verdict]:
    """Make a part's files, and read so many copies of them, each with another bit flipped.

    Args:
        name: Of the part.
        flips: How many.
        seed: Draws the bits.
        tables: Of databases, in which tables and their indexes; empty for those of the part.
    """
    part, random = load(name), Random(f"{name} {seed}")  # noqa: S311 - a plan, no secret
    with tempfile.TemporaryDirectory(dir=_FAST if _FAST.is_dir() else None) as fresh:
        whole, copy = Path(fresh) / "whole", Path(fresh) / "copy"
        whole.mkdir()
        part.make(whole)
        shutil.copytree(whole, copy)
        with listening() as usual:
            expected = part.read(copy)
        shutil.rmtree(copy)
        for _ in range(flips):
            flip = draw(whole, part.files, random, tables or part.tables)
            shutil.copytree(whole, copy)
            flip.apply(copy)
            yield judge(part, copy, expected, usual, flip)
            shutil.rmtree(copy)


def judge(part: Part, folder: Path, expected: Answer, usual: list[str], flip: Flip) -> Verdict:
    """Read a folder and compare what it answers with what it answered when it was whole."""
    with listening() as said:
        try:
            found = part.read(folder)
        except EskinError as error:
            outcome = Outcome.DETECTED if str(error) else Outcome.BROKEN
            return Verdict(flip, outcome, f"{type(error).__name__}: {error}")
        except Exception:  # noqa: BLE001 - what is looked for
            return Verdict(flip, Outcome.BROKEN, traceback.format_exc(limit=-3))
    news = [word for word in said if word not in usual]
    return Verdict(flip, *_compare(expected, found, news))


def _compare(expected: Answer, found: Answer, said: list[str]) -> tuple[Outcome, str]:
    wrong = [key for key, value in found.items() if key not in expected or expected[key] != value]
    lost = [key for key in expected if key not in found]
    crashed = [word for word in said if word.startswith("TRACEBACK")]
    if wrong:
        key = wrong[0]
        return Outcome.BROKEN, f"{key} is {found[key]!r:.300}, was {expected.get(key)!r:.300}"
    if crashed:
        return Outcome.BROKEN, crashed[0]
    if lost and not said:
        return Outcome.BROKEN, f"silently lost: {', '.join(lost)[:300]}"
    return (Outcome.DETECTED, said[0]) if said else (Outcome.HARMLESS, "")
