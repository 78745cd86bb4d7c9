"""What a question is made of: times, windows, cursors, media types, topics."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from eskin_cloud.api.responses import choose
from eskin_cloud.query.opaque_ids import OpaqueIds
from eskin_cloud.store.read.window import parse_time, parse_window

from eskin.errors import MessageError, QueryError
from eskin.wire.timestamp import format_timestamp, parse_timestamp
from eskin.wire.topics import node_topic, parse_node_topic
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path

OFFERED = ("application/json", "text/csv", "application/vnd.apache.parquet")

_LONGEST = 4096
_IDS = OpaqueIds(bytes(32))


def make(_: Path) -> Target:
    """The input is one text, read as each; what is read says the same again."""
    seeds = (
        "2026-01-31T12:00:00Z",
        "2026-01-31 12:00:00.123456789+05:30",
        "1769860800000000000",
        "-9223372036854775807",
        _IDS.write(5, -7),
        _IDS.write_name("fingertip"),
        "text/csv;q=0.5, application/*;q=0.3, */*;q=0",
        "eskin/v1/nodes/fingertip/frames",
    )
    return Target(tuple(seed.encode() for seed in seeds), mutate_text, check)


def check(data: bytes) -> None:
    """Read it as each."""
    text = data[:_LONGEST].decode("utf-8", "replace")
    try:
        instant = parse_timestamp(text)
        assert parse_timestamp(format_timestamp(instant)) == instant
    except ValueError:
        pass
    try:
        found = parse_time("start", text)
        assert found is not None
        assert abs(found) < 2**63
        window = parse_window(text, None, last=0)
        assert window.start <= window.end
    except QueryError:
        pass
    try:
        assert _IDS.read_name(_IDS.write_name(_IDS.read_name(text))) == _IDS.read_name(text)
        numbers = _IDS.read(text, 2)
        assert _IDS.read(_IDS.write(*numbers), 2) == numbers
    except QueryError:
        pass
    assert choose(text, OFFERED) in {*OFFERED, None}
    with suppress(MessageError):
        assert node_topic(*parse_node_topic(text)) == text
