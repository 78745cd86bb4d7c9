"""A process that is to end does, whatever its main thread does at that instant."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import Running

if TYPE_CHECKING:
    from pathlib import Path

_PROGRAM = """
import threading
from eskin.runtime.stop_signals import stop_on_signals
stop = threading.Event()
stop_on_signals(stop)
print("ready", flush=True)
while not stop.wait(0):  # which holds the event's lock most of the time
    pass
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_ends_a_main_thread_that_holds_the_lock_of_its_event(
    tmp_path: Path, number: signal.Signals
) -> None:
    log = tmp_path / "log"
    for _ in range(5):
        log.unlink(missing_ok=True)
        program = Running([sys.executable, "-c", _PROGRAM], log=log)
        program.start()
        program.wait_for(lambda: "ready" in program.output(), "it is ready")  # noqa: B023
        program.signal(number)
        assert program.ended(seconds=20) == 0
