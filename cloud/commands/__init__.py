"""Remote commands: issued and signed here, fetched by gateways, answered by nodes."""

from __future__ import annotations

from cloud.commands.board import Board

__all__ = ["Board"]
