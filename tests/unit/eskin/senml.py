"""SenML as a client reads it that we did not write: KPN's parser."""

from __future__ import annotations

from typing import Any

from kpn_senml import SenmlPack


def read_senml(data: bytes | str, name: str) -> list[tuple[str, float]]:
    """Names and values of all records that it finds, in order.

    Args:
        data: CBOR, or JSON as text.
        name: The base name that is expected; other records are left out.
    """
    found: list[tuple[str, float]] = []

    def take(record: Any, **_: Any) -> None:
        found.append((record.name, record.value))
        record.actuate = take  # stated again when the name comes again

    pack = SenmlPack(name, take)
    if isinstance(data, bytes):
        pack.from_cbor(data)
    else:
        pack.from_json(data)
    return found
