"""The live feed: what was stored, told as it comes, without holes."""

from __future__ import annotations

from eskin_cloud.live.feed import Feed
from eskin_cloud.live.viewers import Viewers

__all__ = ["Feed", "Viewers"]
