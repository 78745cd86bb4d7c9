"""A rate is raised until a cloud refuses, and what it refused is stored once in the end."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import pytest

from benchmarks.capacity import find_capacity
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities

pytestmark = pytest.mark.nightly


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.mark.anyio
async def test_rate_is_raised_until_the_first_refusal_and_nothing_is_lost(
    tmp_path: Path, identities: Identities
) -> None:
    few = "[limits]\nrequests_per_s = 1\n"  # so ten at once, whatever the machine can do
    with Service(tmp_path / "cloud", identities, more=few) as service:
        found = await find_capacity(service, rate=400.0, seconds=0.5, steps=9, behind=inf)
    first, *_, last = found.steps
    assert first.refused == {}
    assert set(last.refused) == {429}
    assert 1 < len(found.steps) < 9
    assert found.stored == found.sent
