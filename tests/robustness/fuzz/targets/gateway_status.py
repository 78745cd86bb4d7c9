"""A gateway's status, in a header as it comes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.ingest.errors import MalformedBatchError
from eskin_cloud.ingest.gateway_status import read_status

from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path


def make(_: Path) -> Target:
    """Only `MalformedBatchError`; what passes are counts that a column of 64 bit holds."""

    def check(data: bytes) -> None:
        try:
            found = read_status(data.decode("latin-1"))
        except MalformedBatchError:
            return
        assert found is not None
        assert all(value is None or 0 <= value < 2**63 for value in found)

    good = (
        b'{"messages":7,"bytes":4096,"capacity_bytes":1000000000,"oldest_ns":null,'
        b'"dead_letters":2,"nodes":3}'
    )
    return Target((good, b"{}", b"[[[[", b'{"messages":"\\ud800"}'), mutate_text, check)
