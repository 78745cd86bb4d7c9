"""End on SIGTERM and SIGINT."""

from __future__ import annotations

import logging
import queue
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

log = logging.getLogger(__name__)


def stop_on_signals(stop: threading.Event) -> None:
    """Set an event on SIGTERM and SIGINT; call it in the main thread.

    A handler interrupts the main thread, which may hold the lock of the event that it waits for: it
    would wait for that lock forever. So a thread sets the event. A `SimpleQueue` may be put to in
    a handler.
    """
    numbers: queue.SimpleQueue[int] = queue.SimpleQueue()

    def end(number: int, _frame: FrameType | None) -> None:
        numbers.put(number)

    def wait() -> None:
        while True:
            log.info("stopping: signal=%s", signal.Signals(numbers.get()).name)
            stop.set()

    threading.Thread(target=wait, name="stop signals", daemon=True).start()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
