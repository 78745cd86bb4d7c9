"""The model and the code name the same actions."""

from __future__ import annotations

import pkgutil
import re
from typing import Final

import pytest

from tests.robustness.model.bounds import SMALL
from tests.robustness.model.mutants import MUTANTS, Mutant
from tests.robustness.model.tlc import MODULES, check, find_jar

_SOURCE: Final = (MODULES / "Delivery.tla").read_text()
_ROW: Final = re.compile(r"^\| (\w+) \| `([\w.]+)` \|$", re.MULTILINE)
_BROKEN_DOWN: Final = {"Closed", "OnlyErasure"}
"""Parts of actions."""
_ROWS: Final = dict(_ROW.findall((MODULES / "README.md").read_text()))


def _exists(name: str) -> bool:
    try:
        return callable(pkgutil.resolve_name(name))
    except (ImportError, AttributeError):
        return False


def _actions() -> set[str]:
    """Definitions that change a variable."""
    found = set()
    for text in re.split(r"\n\s*\n", _SOURCE):
        head = re.search(r"^(\w+)(?:\([^)\n]*\))? ==", text, re.MULTILINE)
        if head is not None and ("UNCHANGED" in text or "OnlyErasure" in text):
            found.add(head.group(1))
    return found - _BROKEN_DOWN


def test_table_names_the_actions_of_the_module() -> None:
    assert _actions() == _ROWS.keys()


@pytest.mark.parametrize("action", _ROWS)
def test_code_of_an_action_exists(action: str) -> None:
    assert _exists(_ROWS[action]), f"{_ROWS[action]} is gone: name what does it now"


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_mutants_can_be_made(mutant: Mutant) -> None:
    assert mutant.apply(_SOURCE) != _SOURCE
    assert mutant.bounds in SMALL


@pytest.mark.nightly
@pytest.mark.skipif(find_jar() is None, reason="`make model` installs TLC")
@pytest.mark.parametrize(
    "mutant",
    [each for each in MUTANTS if "before the commit" in each.name or "too high" in each.name],
    ids=lambda mutant: mutant.name,
)
def test_planted_bug_is_found(mutant: Mutant) -> None:
    configuration = SMALL[mutant.bounds].configuration()
    found = check({"Delivery": mutant.apply(_SOURCE)}, "Delivery", configuration)
    assert found.broken == mutant.broken
