"""Each bug's patch applies to the sources, and names tests that exist."""

from __future__ import annotations

import re
import subprocess

import pytest

from tests.robustness.planted.bugs import ROOT, read_bugs

BUGS = read_bugs()


@pytest.mark.parametrize("name", BUGS)
def test_patch_applies_and_names_a_test(name: str) -> None:
    bug = BUGS[name]
    done = subprocess.run(
        ["git", "apply", "--check", bug.patch],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    file, _, test = bug.caught_by.partition("::")
    text = (ROOT / file).read_text()
    assert not test or re.search(rf"^(?:async )?def {test.partition('[')[0]}\(", text, re.MULTILINE)


def test_there_are_many_bugs() -> None:
    assert len(BUGS) >= 33
