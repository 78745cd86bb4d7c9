"""Connects the members of a fleet one after the other, and reconnects them."""

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
    from eskin_sensor_node.fleet.connection import Connection

log = logging.getLogger(__name__)

_LONGEST_S: Final = 8.0


class Connector:
    """A thread for what blocks: names, TCP and TLS handshakes.

    A connection belongs to it from `connect` until it comes back by `ready`. If the broker is
    unreachable all wait; a member that the broker refuses waits alone.
    """

    def __init__(self) -> None:
        self._requests: queue.SimpleQueue[Connection | None] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[Connection] = queue.SimpleQueue()
        self._waiting: list[tuple[float, int, Connection]] = []
        self._order = itertools.count()
        self._stopping = threading.Event()
        self.wake, self._notifier = socket.socketpair()
        for end in (self.wake, self._notifier):
            end.settimeout(0.0)
        self._thread = threading.Thread(target=self._run, name="connector", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, at most an attempt later."""
        self._stopping.set()
        self._requests.put(None)
        self._thread.join()
        self.wake.close()
        self._notifier.close()

    def connect(self, connection: Connection) -> None:
        """Connect a connection, now or later."""
        self._requests.put(connection)

    def ready(self) -> list[Connection]:
        """Connections whose handshake is over."""
        found: list[Connection] = []
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
        """Take new requests; sleep where nothing is due."""
        pause: float | None = None
        if self._waiting:
            pause = max(0.0, self._waiting[0][0] - time.monotonic())
        try:
            connection = (
                self._requests.get(timeout=pause) if pause != 0.0 else self._requests.get_nowait()
            )
        except queue.Empty:
            return
        if connection is not None:
            delay = (
                min(_LONGEST_S, 2.0 ** (connection.attempts - 1)) if connection.attempts else 0.0
            )
            connection.attempts += 1
            due = time.monotonic() + delay
            heapq.heappush(self._waiting, (due, next(self._order), connection))

    def _attempt(self, connection: Connection) -> None:
        try:
            connection.connect()
        except ssl.SSLError as error:
            log.warning("connection refused: error=%s", error)
            self._requests.put(connection)
        except OSError as error:
            log.warning("broker unreachable: error=%s", error)
            self._requests.put(connection)
            self._stopping.wait(min(_LONGEST_S, 0.5 * connection.attempts))
        except Exception:  # the thread's outermost; the connection counts its attempts
            log.exception("connecting failed, retrying: attempts=%d", connection.attempts)
            self._requests.put(connection)
        else:
            self._done.put(connection)
            try:
                self._notifier.send(b"!")
            except BlockingIOError:  # the other side has enough to wake up for
                return
