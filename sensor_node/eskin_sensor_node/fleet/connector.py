"""Connects a fleet, one member after the other, and again those who were lost."""

from __future__ import annotations

import heapq
import itertools
import logging
import queue
import socket
import ssl
import threading
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from eskin_sensor_node.fleet.radio import Radio

log = logging.getLogger(__name__)

_LONGEST_S: Final = 8.0


class Connector:
    """A thread for what blocks: names, TCP and TLS handshakes.

    A radio belongs to it from `connect` until it comes back by `ready`. A broker that is away keeps
    all waiting; a member whom the broker turns away waits alone.
    """

    def __init__(self) -> None:
        self._wanted: queue.SimpleQueue[Radio | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[Radio] = queue.SimpleQueue()
        self._waiting: list[tuple[float, int, Radio]] = []
        self._order = itertools.count()
        self._stopping = threading.Event()
        self.wake, self._bell = socket.socketpair()
        for end in (self.wake, self._bell):
            end.settimeout(0.0)
        self._thread = threading.Thread(target=self._run, name="connector", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, at most an attempt later."""
        self._stopping.set()
        self._wanted.put(None)
        self._thread.join()
        self.wake.close()
        self._bell.close()

    def connect(self, radio: Radio) -> None:
        """Connect a radio, now or later."""
        self._wanted.put(radio)

    def ready(self) -> list[Radio]:
        """Radios whose handshake is over."""
        found: list[Radio] = []
        try:
            self.wake.recv(4096)
        except BlockingIOError:
            return found
        while True:
            try:
                found.append(self._done.get_nowait())
            except queue.Empty:
                return found

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._take()
            if self._waiting and self._waiting[0][0] <= time.monotonic():
                self._attempt(heapq.heappop(self._waiting)[2])

    def _take(self) -> None:
        """Take new wishes; sleep where nothing is to be done."""
        pause: float | None = None
        if self._waiting:
            pause = max(0.0, self._waiting[0][0] - time.monotonic())
        try:
            radio = self._wanted.get(timeout=pause) if pause != 0.0 else self._wanted.get_nowait()
        except queue.Empty:
            return
        if radio is not None:
            delay = min(_LONGEST_S, 2.0 ** (radio.attempts - 1)) if radio.attempts else 0.0
            radio.attempts += 1
            due = time.monotonic() + delay
            heapq.heappush(self._waiting, (due, next(self._order), radio))

    def _attempt(self, radio: Radio) -> None:
        try:
            radio.connect()
        except ssl.SSLError as error:
            log.warning("a node is turned away: error=%s", error)
            self._wanted.put(radio)
        except OSError as error:
            log.warning("broker cannot be reached, messages wait: error=%s", error)
            self._wanted.put(radio)
            self._stopping.wait(min(_LONGEST_S, 0.5 * radio.attempts))
        except Exception:  # the thread's outermost; the radio counts its attempts
            log.exception("a node cannot connect and tries again: attempts=%d", radio.attempts)
            self._wanted.put(radio)
        else:
            self._done.put(radio)
            try:
                self._bell.send(b"!")
            except BlockingIOError:  # the other side has enough to wake up for
                return
