"""The live feed: what is stored, as it arrives, without gaps."""

from __future__ import annotations

from eskin_cloud.live.contacts import LiveContacts
from eskin_cloud.live.feed import Feed

__all__ = ["Feed", "LiveContacts"]
