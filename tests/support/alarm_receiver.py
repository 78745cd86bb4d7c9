"""A receiver of alarms that fails as receivers do.

``python -m tests.support.alarm_receiver PORT FILE SEED`` listens on loopback until it is ended. It
appends each document that it takes to the file, as a line. Of fifty requests it takes two and
answers nothing, refuses three, and lets one wait until its sender has given up.
"""

from __future__ import annotations

import json
import os
import random
import sys
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple

_HANG_S: Final = 4.0


class Taken(NamedTuple):
    """A document that was taken.

    Attributes:
        key: Its idempotency key.
        document: What it says.
    """

    key: str
    document: dict[str, Any]


def read_taken(file: Path) -> list[Taken]:
    """What a receiver took, in order."""
    lines = file.read_text().splitlines() if file.exists() else []
    return [Taken(*json.loads(line)) for line in lines]


class _Receiver(ThreadingHTTPServer):
    def __init__(self, port: int, file: Path, seed: int) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.file, self.draw, self.lock = file, random.Random(seed), Lock()  # noqa: S311 - no secret


class _Handler(BaseHTTPRequestHandler):
    server: _Receiver

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        with self.server.lock:
            fate = self.server.draw.randrange(50)
            if fate > 3:
                with self.server.file.open("a") as out:
                    out.write(json.dumps([self.headers["webhook-id"], json.loads(body)]) + "\n")
                    out.flush()
                    os.fsync(out.fileno())
        if fate > 47:
            self.close_connection = True
            return
        if fate == 0:
            time.sleep(_HANG_S)
        self.send_response(204 if fate > 3 else 500)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Nothing: the file says what came."""


if __name__ == "__main__":
    with _Receiver(int(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])) as server:
        server.serve_forever()
