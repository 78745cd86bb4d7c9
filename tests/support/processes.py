"""Real processes in tests: started, waited for by condition, ended by id."""

from __future__ import annotations

import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn, Self

from eskin.demo.ports import free_ports

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import FrameType, TracebackType

ESKIN = str(Path(sys.executable).with_name("eskin"))
"""The installed command."""
PLAIN: Final = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
"""For clients of plain HTTP, which would read the web's roots else: 20 ms of CPU in each poll."""
_SHORTEST_S: Final = 0.02
_LONG_S: Final = 120.0
"""For what takes a few seconds: some share the processor, and it may be slow. A test that
asserts that something comes soon names a time of its own."""


def free_port() -> int:
    """A TCP port that is free on loopback now."""
    (port,) = free_ports(1)
    return port


def accepts(port: int) -> bool:
    """Whether something listens on a port."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_until(condition: Callable[[], bool], what: str, *, seconds: float = _LONG_S) -> None:
    """Wait for a condition; fail with its name when it does not come.

    At least half of the time is left to those that are waited for.
    """
    deadline = time.monotonic() + seconds
    while True:
        asked = time.monotonic()
        if condition():
            return
        if asked > deadline:
            raise AssertionError(f"after {seconds:g} s still not: {what}")
        time.sleep(max(_SHORTEST_S, time.monotonic() - asked))


@contextmanager
def unwound_by_signals() -> Iterator[None]:
    """For a command: ending it by SIGTERM or SIGINT ends what it started, too.

    Python dies of the first at once; a shell has what it starts in the background ignore the other.
    """
    before = {number: signal.signal(number, _leave) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number: int, _: FrameType | None) -> NoReturn:
    sys.exit(128 + number)


class Running:
    """A process with its output in a file; ended when the block is left."""

    def __init__(
        self, argv: Sequence[str], *, log: Path, env: Mapping[str, str] | None = None
    ) -> None:
        self.argv = list(argv)
        self.log = log
        self._env = {**os.environ, "PYTHONFAULTHANDLER": "1", **(env or {})}
        self.process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Start it, or start it again."""
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(
                self.argv,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=self._env,
            )

    def wait_for(
        self, condition: Callable[[], bool], what: str, *, seconds: float = _LONG_S
    ) -> None:
        """Wait for a condition while the process lives."""

        def checked() -> bool:
            assert self.process is not None
            status = self.process.poll()
            assert status is None, f"{self.argv[0]} ended with {status}:\n{self.output()}"
            return condition()

        try:
            wait_until(checked, what, seconds=seconds)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.output()}") from None

    def output(self) -> str:
        """What it wrote so far."""
        return self.log.read_text(errors="replace")

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        assert self.process is not None
        self.process.send_signal(number)

    def terminate(self) -> None:
        """Tell it to end, as an operator would."""
        assert self.process is not None
        self.process.terminate()

    def kill(self) -> None:
        """End it as a power cut would."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def ended(self, *, seconds: float = _LONG_S) -> int:
        """Wait until it ends by itself; gives its exit status."""
        assert self.process is not None
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"did not end by itself:\n{self.output()}") from None

    def stop(self, *, seconds: float = _LONG_S) -> int:
        """End it as an operator would; gives its exit status."""
        assert self.process is not None
        if self.process.poll() is None:
            self.terminate()
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.send_signal(signal.SIGABRT)  # where it hangs stands in its log then
            self.process.wait()
            raise AssertionError(f"did not end on SIGTERM:\n{self.output()}") from None
