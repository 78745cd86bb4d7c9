"""A client of the cloud for notebooks and programs: `connect`, then ask for tubes."""

from __future__ import annotations

from eskin.client.client import Client, connect
from eskin.client.release import verify_release

__all__ = ["Client", "connect", "verify_release"]
