"""What a gateway tells of itself in its token."""

from __future__ import annotations

from typing import Final, NamedTuple

from cloud.ingest.errors import UnauthenticatedError

_MOST: Final = 2**62
"""Some counts are added up in 64 bit."""


class Condition(NamedTuple):
    """How a gateway fares.

    Attributes:
        messages: Messages in its spool.
        used: Their bytes.
        capacity: Most bytes.
        oldest: For how long the oldest has waited, ns; ``None`` where none waits.
        dead_letters: Messages that it could not use.
        nodes: How many nodes it hears.
    """

    messages: int
    used: int
    capacity: int
    oldest: int | None
    dead_letters: int
    nodes: int

    @classmethod
    def read(cls, claim: object) -> Condition | None:
        """Read the claim ``state``; an absent one says nothing.

        Raises:
            UnauthenticatedError: It is not as agreed.
        """
        if claim is None:
            return None
        names = ("messages", "bytes", "capacity_bytes", "oldest_ns", "dead_letters", "nodes")
        if not isinstance(claim, dict) or set(claim) != set(names):
            raise UnauthenticatedError(f"state is no map of {', '.join(names)}")
        for name, value in claim.items():
            nothing = name == "oldest_ns" and value is None
            if not nothing and (type(value) is not int or not 0 <= value <= _MOST):
                raise UnauthenticatedError(f"state: {name} is {value!r}, no count up to {_MOST}")
        return cls(*(claim[name] for name in names))
