"""A process of the demo: started, watched, started again when it dies, ended."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import subprocess
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from eskin.errors import EskinError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

log = logging.getLogger(__name__)

_LONGEST_PAUSE_S: Final = 10.0
_PATIENCE_S: Final = 10.0
_WELL_S: Final = 60.0
"""Who has run for so long is well: what ended it is none of the troubles of before."""
_TAIL: Final = 15
_PR_SET_PDEATHSIG: Final = 1


class SupervisedProcessError(EskinError):
    """A process of the demo did not come up."""


class SupervisedProcess:
    """One process, its output in a log file.

    Args:
        name: Name in the log.
        argv: What to run.
        log_file: Takes its output.
        environment: Variables on top of ours.
    """

    def __init__(
        self,
        name: str,
        argv: Sequence[str],
        *,
        log_file: Path,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        self._argv = list(argv)
        self._log_file = log_file
        self._environment = {**os.environ, **(environment or {})}
        self._process: subprocess.Popen[bytes] | None = None
        self._deaths = 0
        self._again_at = 0.0
        self._began = 0.0
        self._asked = False
        self._log_before = 0

    def start(self) -> None:
        """Start it.

        Raises:
            ChildError: The program cannot be run.
        """
        self._log_file.parent.mkdir(parents=True, exist_ok=True)
        self._began = time.monotonic()
        self._asked = False
        try:
            with self._log_file.open("ab") as output:
                self._log_before = output.tell()
                # A session of its own: Ctrl-C reaches the demo alone, which ends its children in
                # order.
                self._process = subprocess.Popen(  # noqa: S603 - our own programs
                    self._argv,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    stdin=subprocess.DEVNULL,
                    env=self._environment,
                    start_new_session=True,
                    preexec_fn=_end_with_parent(),  # noqa: PLW1509 - one system call
                )
        except OSError as error:
            raise SupervisedProcessError(f"{self.name} cannot be started: {error}") from error

    @property
    def pid(self) -> int | None:
        """Its process id, if it runs."""
        return self._process.pid if self._process and self._process.poll() is None else None

    def require_alive(self) -> None:
        """Check that it has not died.

        Raises:
            ChildError: It has; shows the end of its log, without earlier starts.
        """
        if self._process is not None and self._process.poll() is not None:
            raise SupervisedProcessError(
                f"{self.name} ended with status {self._process.returncode}; "
                f"the end of {self._log_file}:\n{self._tail()}"
            )

    def keep_alive(self) -> None:
        """Start it again if it died, after a pause that grows with each death."""
        if self.pid is not None:
            return
        now = time.monotonic()
        if self._again_at == 0.0:
            status = self._process.returncode if self._process else None
            if now > self._began + _WELL_S:
                self._deaths = 0
            pause = min(0.5 * 2.0**self._deaths, _LONGEST_PAUSE_S)
            self._deaths += 1
            self._again_at = now + pause
            log.warning("%s ended with status %s; again in %.1f s", self.name, status, pause)
        elif now >= self._again_at:
            self._again_at = 0.0
            self.start()

    def restart(self) -> None:
        """End it and start it again, which is no death.

        Raises:
            ChildError: The program cannot be run.
        """
        self.stop()
        self.start()

    def reload(self) -> None:
        """Have it read its files anew (SIGHUP)."""
        if self._process is not None:
            self._process.send_signal(signal.SIGHUP)

    def terminate(self) -> None:
        """Ask it to end, once."""
        if self._process is not None and self._process.poll() is None and not self._asked:
            self._asked = True
            self._process.terminate()

    def stop(self) -> None:
        """End it: SIGTERM, and SIGKILL after 10 s; what outlives even that is left, and logged."""
        process = self._process
        if process is None or process.poll() is not None:
            return
        self.terminate()
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            log.warning("%s did not end within %g s; killed", self.name, _PATIENCE_S)
            process.kill()
            with suppress(subprocess.TimeoutExpired):
                process.wait(_PATIENCE_S)
                return
            # Held by the kernel, as on a disk that does not answer: it ends once it is let go.
            log.warning("%s, process %d, does not end even killed; left", self.name, process.pid)

    def _tail(self) -> str:
        with self._log_file.open("rb") as file:
            file.seek(self._log_before)
            lines = file.read().decode(errors="replace").splitlines()
        return "\n".join(lines[-_TAIL:])


def _end_with_parent() -> Callable[[], None]:
    """So that no process outlives a demo that was killed (Linux, prctl(2))."""
    libc = ctypes.CDLL(None, use_errno=True)

    def ask() -> None:
        libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)

    return ask
