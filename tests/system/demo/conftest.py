"""One running demo for all tests that only look at it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.support.demos import RunningDemo

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(scope="package")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDemo]:
    """A demo as ``make demo`` starts it, but slower, as tests run beside it; with some data."""
    with RunningDemo(tmp_path_factory.mktemp("demo") / "data", "--speed", "0.25") as running:
        running.wait_for_more(["fingertip", "palm", "forearm", "hand"])
        yield running
