"""Commands that cannot be taken now."""

from __future__ import annotations

from eskin.errors import EskinError


class BacklogError(EskinError):
    """Too many commands wait for a node's answer already."""
