"""Logs of a process: one line an event, UTC, on standard error; for all loggers, libraries' too."""

from __future__ import annotations

import logging
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from eskin.runtime.log_throttle import LogThrottle, Source
from eskin.runtime.printable import INDENT, printable, printable_lines

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

log = logging.getLogger(__name__)

_CHATTY: Final = ("httpx", "httpcore", "amqtt", "transitions")


class LogFormatter(logging.Formatter):
    """One line an event; tracebacks follow indented, so that no text of a peer begins a line."""

    converter = staticmethod(time.gmtime)

    def __init__(self) -> None:
        super().__init__(
            "%(asctime)s.%(msecs)03dZ %(levelname)s %(name)s %(message)s", "%Y-%m-%dT%H:%M:%S"
        )

    def format(self, record: logging.LogRecord) -> str:
        """Format a record, with no control character in it."""
        record.exc_text = None  # what another formatter may have left
        return super().format(record)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The line of an event."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: object) -> str:  # noqa: N802 - likewise
        """A traceback."""
        return _indented(super().formatException(ei))  # type: ignore[arg-type]

    def formatStack(self, stack_info: str) -> str:  # noqa: N802 - likewise
        """A stack."""
        return _indented(super().formatStack(stack_info))


class ThrottledHandler(logging.StreamHandler[TextIO]):
    """Writes a few lines of each statement in each window, and how many it suppressed.

    A statement tells sources apart by ``extra={"source": ...}``, such as a gateway's name, so that
    one peer's lines do not hide another's.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.setFormatter(LogFormatter())
        self._throttle = LogThrottle(clock)

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or count it."""
        self._tell_suppressed()
        source = Source(record.pathname, record.lineno, str(getattr(record, "source", "")))
        if self._throttle.admit(source):
            super().emit(record)

    def close(self) -> None:
        """Tell what was suppressed until the end."""
        self._tell_suppressed(early=True)
        super().close()

    def _tell_suppressed(self, *, early: bool = False) -> None:
        for source, count in self._throttle.ended(early=early):
            text = "log lines suppressed: count=%d statement=%s:%d source=%s"
            values = count, Path(source.file).name, source.line, source.key or "-"
            super().emit(
                logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, values, None)
            )


def start_logs(level: str) -> None:
    """Send logs of a level and above to standard error, and what ends a thread or the process."""
    root = logging.getLogger()
    root.addHandler(ThrottledHandler())
    root.setLevel(level)
    # Libraries' own chatter is no event of ours.
    for chatty in _CHATTY:
        logging.getLogger(chatty).setLevel(logging.WARNING)
    # Nor is a peer's bad request.
    logging.getLogger("uvicorn").setLevel(logging.ERROR)
    sys.excepthook = _tell_end
    threading.excepthook = _tell_end_of_thread


def _tell_end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        return
    log.critical("unexpected error ends the process", exc_info=(kind, error, trace))


def _tell_end_of_thread(ended: threading.ExceptHookArgs) -> None:
    if ended.exc_type is SystemExit:
        return
    error = ended.exc_value or ended.exc_type()
    name = ended.thread.name if ended.thread else "-"
    log.critical(
        "unexpected error ends a thread: thread=%s",
        name,
        exc_info=(ended.exc_type, error, ended.exc_traceback),
    )


def _indented(text: str) -> str:
    return INDENT + printable_lines(text)
