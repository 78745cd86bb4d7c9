"""The page lists what a sample and a command pass."""

from __future__ import annotations

from typing import Final

import pytest

from tests.architecture import path

_TRACES: Final = 3
"""On a busy machine something rare may run in a window, such as sending again."""


@pytest.mark.nightly
@pytest.mark.timeout(300)
def test_page_lists_files_and_types_of_both_paths() -> None:
    listed = path.PAGE.read_text().partition(path.BEGIN)[2].partition(path.END)[0]
    differing = []
    for _ in range(_TRACES):
        traced = path.describe(*path.trace())
        if traced == listed:
            return
        differing.append(set(listed.split()) ^ set(traced.split()))
    raise AssertionError(f"{differing}; python -m tests.architecture.path --update")
