"""Logs of a process: one line an event, UTC, on standard error; for all loggers, libraries' too."""

from __future__ import annotations

import logging
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TextIO

from eskin.runtime.printable import INDENT, printable, printable_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

log = logging.getLogger(__name__)

BURST: Final = 10
WINDOW_S: Final = 10.0
_MOST_SOURCES: Final = 1000
_CHATTY: Final = ("httpx", "httpcore", "amqtt", "transitions")


class Source(NamedTuple):
    """What lines are counted together.

    Attributes:
        file: Of the statement that logs.
        line: Of the statement.
        key: What the statement distinguishes, such as a gateway's name; mostly empty.
    """

    file: str
    line: int
    key: str = ""


@dataclass(slots=True)
class _Window:
    start: float
    count: int = 0


class LogThrottle:
    """Admits `BURST` lines of each source in `WINDOW_S` seconds. Not thread-safe.

    Beyond 1,000 sources in one window, keys are ignored: this bounds the memory.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._windows: dict[Source, _Window] = {}

    def admit(self, source: Source) -> bool:
        """Count a line; gives whether it may be written. Call `ended` before."""
        if source not in self._windows and len(self._windows) >= _MOST_SOURCES:
            source = source._replace(key="")
        window = self._windows.setdefault(source, _Window(self._clock()))
        window.count += 1
        return window.count <= BURST

    def ended(self, *, early: bool = False) -> Iterator[tuple[Source, int]]:
        """Forget windows that are over; gives how many lines of each were suppressed, if any.

        Args:
            early: Also those that are not over yet, as the process ends.
        """
        now = self._clock()
        for source, window in list(self._windows.items()):
            if early or now >= window.start + WINDOW_S:
                del self._windows[source]
                if window.count > BURST:
                    yield source, window.count - BURST


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

    A statement names its source by ``extra={"source": ...}``, such as a gateway's name, so that
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
