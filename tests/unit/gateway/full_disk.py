"""Fills a small disk with a spool and then empties the spool: a child process of the tests.

``python -m tests.unit.gateway.full_disk FOLDER``, in a mount namespace of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.spool.spool import RESERVE, Spool

from eskin.errors import SpoolError


def main(folder: Path) -> None:
    size = RESERVE + 8_000_000
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    subprocess.run(mount, check=True)
    spool = Spool(folder / "spool.db", capacity=10**9, max_dead_letters=3)
    committed, refusal = fill(spool)
    take_the_rest(folder / "other")
    taken = []
    while messages := spool.take(40, 10**9):
        taken += [int.from_bytes(message.body[:8]) for message in messages]
        spool.settle(messages)
    again, _ = fill(spool)
    spool.close()
    seen = {"committed": committed, "refusal": refusal, "taken": taken, "again": again}
    sys.stdout.write(json.dumps(seen))


def take_the_rest(path: Path) -> None:
    with path.open("wb", buffering=0) as other, suppress(OSError):
        while other.write(bytes(4096)):
            pass


def fill(spool: Spool) -> tuple[int, str]:
    number = 0
    while True:
        entries = [SpoolMessage("n", 1, (number + k).to_bytes(8) + bytes(3000)) for k in range(3)]
        try:
            spool.commit(Batch(entries))
        except SpoolError as error:
            return number, str(error)
        number += 3


if __name__ == "__main__":
    main(Path(sys.argv[1]))
