"""No text of a peer begins a log line, and no flood fills a disk with lines."""

from __future__ import annotations

import io
import logging
import re
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.runtime.logs import BURST, WINDOW_S, LogFormatter, LogThrottle, Source, ThrottledHandler
from eskin.runtime.printable import printable, printable_lines

EVENT = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z [A-Z]+ \S+ ")
HOSTILE = [
    *map(chr, range(0x20)),
    *map(chr, range(0x7F, 0xA0)),
    *"\u061c\u200b\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069",
    "\ufeff",
    "\ud800",
]
texts = st.lists(st.sampled_from(HOSTILE) | st.text(max_size=5)).map("".join)


def raised(text: str) -> Exception:
    try:
        try:
            raise ValueError(text)  # noqa: TRY301 - what is tested
        except ValueError as error:
            raise KeyError(text) from error
    except KeyError as error:
        return error


@given(texts, texts)
def test_event_is_one_line_whatever_it_says(text: str, name: str) -> None:
    record = logging.LogRecord(
        f"paho.{name}", 30, "f", 1, "refused: %s " + text, ("x" + text,), None
    )
    line = LogFormatter().format(record)
    assert line.isprintable()
    assert EVENT.match(line)


@given(texts)
def test_traceback_is_indented_whatever_it_says(text: str) -> None:
    error = raised(text)
    record = logging.LogRecord("uvicorn.error", 40, "f", 1, "broke", (), None)
    record.exc_info = (type(error), error, error.__traceback__)
    record.exc_text = "left by another\nformatter"
    first, *others = LogFormatter().format(record).split("\n")
    assert EVENT.match(first)
    assert others
    assert all(line.startswith("    ") and line.isprintable() for line in others)


@pytest.mark.parametrize("character", HOSTILE)
def test_hostile_character_is_escaped_as_python_would_write_it(character: str) -> None:
    shown = printable(f"a{character}b")
    assert shown.isprintable()
    assert shown.isascii()
    assert shown.encode().decode("unicode_escape") == f"a{character}b"


@given(st.text())
def test_printable_text_is_left_as_it_is(text: str) -> None:
    assert printable(repr(text)) == repr(text)


def test_lines_after_the_first_are_indented() -> None:
    assert printable_lines("a\n2026\x1b[2J") == "a\n    2026\\x1b[2J"


def log_of(name: str, now: list[float]) -> tuple[logging.Logger, io.StringIO, ThrottledHandler]:
    handler = ThrottledHandler(lambda: now[0])
    stream = handler.stream = io.StringIO()
    log = logging.getLogger(f"tests.{name}")
    log.propagate = False
    log.addHandler(handler)
    return log, stream, handler


def test_flood_is_few_lines_and_a_count() -> None:
    now = [0.0]
    log, stream, handler = log_of("flood", now)
    for number in range(15_000):
        log.warning("refused: %d", number)
    assert len(stream.getvalue().splitlines()) == BURST
    now[0] += WINDOW_S
    log.warning("something else")
    *_, count, other = stream.getvalue().splitlines()
    assert f"count={15_000 - BURST}" in count
    assert "test_logs.py" in count
    assert "something else" in other
    handler.close()
    assert len(stream.getvalue().splitlines()) == BURST + 2


def test_what_was_suppressed_last_is_logged_at_the_end() -> None:
    log, stream, handler = log_of("end", [0.0])
    for number in range(BURST + 3):
        log.warning("refused: %d", number)
    handler.close()
    assert "count=3" in stream.getvalue().splitlines()[-1]


def test_flood_of_one_source_hides_no_other() -> None:
    log, stream, _ = log_of("sources", [0.0])
    for number in range(100):
        for source in ("loud", "loud", "loud", "quiet"):
            if source == "loud" or number < BURST:
                log.warning("refused: gateway=%s", source, extra={"source": source})
    lines = stream.getvalue().splitlines()
    assert sum("gateway=loud" in line for line in lines) == BURST
    assert sum("gateway=quiet" in line for line in lines) == BURST


def test_sources_without_end_take_bounded_memory_and_lines() -> None:
    throttle = LogThrottle(lambda: 0.0)
    admitted = sum(throttle.admit(Source("f", 1, str(number))) for number in range(100_000))
    assert admitted <= 1000 + BURST
    assert sum(count for _, count in throttle.ended(early=True)) == 100_000 - admitted


def test_errors_that_end_threads_and_processes_are_formatted_too() -> None:
    program = """
import threading
from eskin.runtime.logs import start_logs
start_logs("INFO")
def broken():
    raise ValueError("x\\n2026-11-24T00:00:00.000Z INFO gateway forged")
thread = threading.Thread(target=broken)
thread.start()
thread.join()
broken()
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    lines = ended.stderr.splitlines()
    assert sum(" CRITICAL " in line for line in lines) == 2
    assert all(EVENT.match(line) or line.startswith("    ") for line in lines)
    assert not any(line.startswith("2026-11-24T00:00:00.000Z") for line in lines)
