"""A client of the cloud for notebooks and programs: `connect`, then ask for tubes."""

from __future__ import annotations

from eskin.client.client import Client, connect

__all__ = ["Client", "connect"]
