"""The live feed: what was stored, told as it comes, without holes."""

from __future__ import annotations

from cloud.live.feed import Feed
from cloud.live.onlookers import Onlookers

__all__ = ["Feed", "Onlookers"]
