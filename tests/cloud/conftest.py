"""Fixtures of the cloud's tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from cloud.store import Store
from tests.cloud.clouds import Clock, Stand, standing
from tests.cloud.messages import START

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.identities import Identities


@pytest.fixture
def clock() -> Clock:
    """A clock at the time of the test messages."""
    return Clock(START)


@pytest.fixture
def store(tmp_path: Path, clock: Clock) -> Iterator[Store]:
    """An empty store."""
    with Store(tmp_path / "store.sqlite", clock=clock) as opened:
        yield opened


@pytest.fixture
def stand(tmp_path: Path, identities: Identities) -> Iterator[Stand]:
    """A cloud with clients."""
    with standing(tmp_path, identities) as made:
        yield made


@pytest.fixture
def anyio_backend() -> str:
    """Asynchronous tests run on asyncio, as the cloud does."""
    return "asyncio"
