"""Which stored channels a formula reads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.errors import MonitorError, QueryError
from eskin.monitor import parse

if TYPE_CHECKING:
    from eskin.monitor import Formula

MOST_CHANNELS: Final = 16


def parse_formula(text: str) -> Formula:
    """Parse a formula.

    Raises:
        QueryError: It is invalid.
    """
    try:
        return parse(text)
    except MonitorError as error:
        raise QueryError("formula", str(error)) from error


def channel_places(formula: Formula, node: str | None) -> dict[str, tuple[str, str]]:
    """Node and channel of each channel that a formula measures, by its name there.

    Args:
        formula: The formula.
        node: Of channels without one; others are ``NODE/CHANNEL``.

    Raises:
        QueryError: It reads none, or too many, or a channel has no node.
    """
    names = sorted(formula.sources)
    if not names:
        raise QueryError("formula", "reads no channel")
    if len(names) > MOST_CHANNELS:
        raise QueryError("formula", f"reads {len(names)} channels, over {MOST_CHANNELS}")
    found = {}
    for name in names:
        own, slash, channel = name.rpartition("/")
        if not slash and node is None:
            raise QueryError(
                "node", f'is missing: {name} has no node; give one, or write "NODE/{name}"'
            )
        found[name] = own if slash else str(node), channel
    return found
