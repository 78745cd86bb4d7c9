"""Traces that TLC accepts, and traces of bugs."""

from __future__ import annotations

import pytest

from tests.robustness.model.tlc import find_jar
from tests.robustness.model.traces import Event, check_windows, windows

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(find_jar() is None, reason="`make model` installs TLC"),
]

_GOOD = (
    ("made", "", 7, 10),
    ("made", "", 7, 12),
    ("spooled", "a", 7, 10),
    ("spooled", "b", 7, 10),
    ("freed", "", 7, 10),
    ("spooled", "a", 7, 12),
    ("cut", "a", 7, 12),
    ("stored", "", 7, 10),
    ("settled", "b", 7, 10),
    ("settled", "a", 7, 10),
    ("made", "", 9, 0),
    ("evicted", "", 9, 0),
    ("stored", "", 7, 12),
    ("settled", "a", 7, 12),
    ("freed", "", 7, 12),
)


def _events(rows: list[tuple[str, str, int, int]]) -> list[Event]:
    return [
        Event(float(time), what, "palm", boot, sequence, gateway)
        for time, (what, gateway, boot, sequence) in enumerate(rows)
    ]


def test_what_happens_in_order_is_a_behaviour() -> None:
    assert check_windows(windows(_events(list(_GOOD)))).broken is None


@pytest.mark.parametrize(
    ("without", "instead"),
    [
        (("spooled", "a", 7, 12), None),  # acknowledged before the commit, which then failed
        (("cut", "a", 7, 12), ("cut", "a", 7, 13)),  # a cut-off one too high
        (("stored", "", 7, 12), None),  # answered before the commit
        (("spooled", "b", 7, 10), ("spooled", "a", 7, 10)),  # spooled twice
        (("settled", "b", 7, 10), ("stored", "", 7, 10)),  # stored twice
        (("spooled", "a", 7, 10), ("freed", "", 7, 12)),  # a span one too high
    ],
)
def test_bugs_are_no_behaviour(
    without: tuple[str, str, int, int], instead: tuple[str, str, int, int] | None
) -> None:
    rows = [instead if row == without else row for row in _GOOD]
    result = check_windows(windows(_events([row for row in rows if row is not None])))
    assert result.broken == "deadlock"
    assert result.length > 1
    assert result.last("window") in {1, 2}
