"""Remote commands: issued and signed here, fetched by gateways, answered by nodes."""

from __future__ import annotations

from eskin_cloud.commands.notifier import Notifier

__all__ = ["Notifier"]
