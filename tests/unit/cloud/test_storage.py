"""What the store takes of the disk, for each sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_bytes_a_sample_are_all_bytes_by_all_samples(stand: Stand) -> None:
    empty = (await stand.get("/api/v1/storage")).json()
    assert empty["samples"] == 0
    assert empty["bytes_per_sample"] is None
    lo = np.random.default_rng(1).random((20, 500))
    put(stand.cloud.store, *(stretch(k, each, each + 1.0) for k, each in enumerate(lo)))
    found = (await stand.get("/api/v1/storage")).json()
    assert found["samples"] == 10_000
    # Of each sample a base of 24 bits is kept, whatever else is.
    assert found["bytes"] - found["free_bytes"] > 30_000
    each = (found["bytes"] - found["free_bytes"]) / 10_000
    assert found["bytes_per_sample"] == pytest.approx(each)
    stated = f"eskin_cloud_store_bytes_per_sample {found['bytes_per_sample']}"
    assert stated in stand.cloud.metrics.write().decode()
