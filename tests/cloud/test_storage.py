"""What the store takes of the disk, for each sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.cloud.clouds import put
from tests.cloud.messages import block

if TYPE_CHECKING:
    from tests.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_bytes_a_sample_are_all_bytes_by_all_samples(stand: Stand) -> None:
    empty = (await stand.get("/api/v1/storage")).json()
    assert empty["samples"] == 0
    assert empty["bytes_per_sample"] is None
    put(stand.cloud.store, *(block(k, [1.0] * 500, [2.0] * 500) for k in range(20)))
    found = (await stand.get("/api/v1/storage")).json()
    assert found["samples"] == 10_000
    # Of each sample two floats of 64 bit are kept, whatever else is.
    assert found["bytes"] - found["free_bytes"] > 160_000
    each = (found["bytes"] - found["free_bytes"]) / 10_000
    assert found["bytes_per_sample"] == pytest.approx(each)
    told = f"eskin_cloud_store_bytes_per_sample {found['bytes_per_sample']}"
    assert told in stand.cloud.metrics.write().decode()
