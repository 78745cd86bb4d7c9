"""A flood of bad messages fills no disk, and forges no log lines."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.errors import MessageError
from gateway.complaints import BURST, WINDOW_S, Complaints
from gateway.reason import Reason
from tests.gateway.twins import Clock

if TYPE_CHECKING:
    import pytest


def test_flood_is_told_in_few_lines_with_the_rest_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = Clock()
    complaints = Complaints(clock=clock)
    with caplog.at_level(logging.WARNING):
        for _ in range(1000):
            complaints.say(Reason.FORGED, topic="t", error=MessageError("bad"))
        complaints.say(Reason.MALFORMED, topic="t", error=MessageError("bad"))
        assert len(caplog.messages) == BURST + 1
        clock.seconds += WINDOW_S
        complaints.settle()
    assert caplog.messages[-1] == f"messages rejected: reason=forged more={1000 - BURST}"


def test_flood_that_goes_on_is_told_again(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    complaints = Complaints(clock=clock)
    for _ in range(3):
        for _ in range(100):
            complaints.say(Reason.FORGED, topic="t", error=MessageError("bad"))
        clock.seconds += WINDOW_S
    assert len(caplog.messages) == 3 * BURST + 2


def test_strangers_text_cannot_break_the_line(caplog: pytest.LogCaptureFixture) -> None:
    Complaints().say(Reason.TOPIC, topic="a\nb" * 1000, error=MessageError("x\r\ny\x1b[2J"))
    (line,) = caplog.messages
    assert line.isprintable()
    assert len(line) < 500
