"""Bugs to plant: a patch each, with the tests that must catch it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[3]
FOLDER: Final = Path(__file__).parent
_CAUGHT_BY: Final = re.compile(r"^# caught-by: (\S+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Bug:
    """One bug.

    Attributes:
        name: Of its patch, without the suffix.
        patch: The patch, for ``git apply``.
        caught_by: The tests that fail with it, as pytest names them, or a file of the dashboard's.
    """

    name: str
    patch: Path
    caught_by: str

    @property
    def in_dashboard(self) -> bool:
        """Whether vitest runs the tests, and not pytest."""
        return self.caught_by.endswith(".ts")


def read_bugs() -> dict[str, Bug]:
    """All bugs by name.

    Raises:
        ValueError: A patch does not name its tests.
    """
    found = {}
    for patch in sorted(FOLDER.glob("*.patch")):
        named = _CAUGHT_BY.findall(patch.read_text())
        if len(named) != 1:
            raise ValueError(f"{patch}: name the tests once, as in '# caught-by: tests/unit/...'")
        found[patch.stem] = Bug(patch.stem, patch, named[0])
    return found
