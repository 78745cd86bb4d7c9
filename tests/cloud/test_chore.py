"""Work in the background goes on whatever becomes of it."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest

from cloud.chore import repeat

if TYPE_CHECKING:
    from tests.cloud.clouds import Stand


@pytest.mark.anyio
async def test_work_that_broke_is_counted_and_tried_again(stand: Stand) -> None:
    stopping = asyncio.Event()
    done = 0

    async def work() -> None:
        nonlocal done
        done += 1
        if done < 3:
            raise OverflowError("nobody foresaw it")
        stopping.set()

    await repeat("work", work, cloud=stand.cloud, stopping=stopping, every_s=0.001)
    assert done == 3
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()
