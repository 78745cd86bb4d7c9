"""A gateway's report of its own status, in a header of each request."""

from __future__ import annotations

from typing import Final

import orjson

from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.store.write.gateways import GatewayStatus

HEADER: Final = "Eskin-Gateway-Status"
_LONGEST: Final = 1024

_MOST: Final = 2**62
"""Some counts are added up in 64 bit."""


def read_status(header: str | None) -> GatewayStatus | None:
    """Read the header, a JSON object; ``None`` where it is absent.

    Raises:
        MalformedBatchError: It is malformed.
    """
    if header is None:
        return None
    names = ("messages", "bytes", "capacity_bytes", "oldest_ns", "dead_letters", "nodes")
    try:
        fields = orjson.loads(header) if len(header) <= _LONGEST else None
    except orjson.JSONDecodeError:
        fields = None
    if not isinstance(fields, dict) or set(fields) != set(names):
        raise MalformedBatchError(f"{HEADER} is no JSON object of {', '.join(names)}")
    for name, value in fields.items():
        nothing = name == "oldest_ns" and value is None
        if not nothing and (type(value) is not int or not 0 <= value <= _MOST):
            raise MalformedBatchError(f"{HEADER}: {name} is {value!r}, no count up to {_MOST}")
    return GatewayStatus(*(fields[name] for name in names))
