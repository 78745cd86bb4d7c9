"""Questions about what is not there."""

from __future__ import annotations

from eskin.errors import QueryError


class UnknownChannelError(QueryError):
    """A node or a channel that never said anything."""
