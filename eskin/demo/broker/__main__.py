"""The embedded broker as a process: ``python -m eskin.demo.broker IDENTITY CA PORT``."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from pathlib import Path

import uvloop

from eskin.demo.broker.broker import LoopbackBroker
from eskin.demo.broker.client_auth import ClientAuth
from eskin.identity import Identity
from eskin.runtime.logs import start_logs


async def serve(directory: Path, authority: Path, port: int) -> None:
    """Serve until SIGTERM or SIGINT."""
    identity = Identity.load(directory)
    broker = LoopbackBroker(identity, client_auth=ClientAuth(authority), port=port)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    await broker.start()
    logging.getLogger(__name__).info("ready: port=%d", port)
    watch = asyncio.create_task(broker.keep_out_the_revoked(), name="revocations")
    await stop.wait()
    watch.cancel()
    await broker.shutdown()


def _in_one_line(record: logging.LogRecord) -> bool:
    """Amqtt logs a whole traceback for each client that answers late."""
    if record.name.startswith("amqtt") and record.exc_info:
        record.msg, record.args = f"{record.getMessage()}: {record.exc_info[1]!r}", None
        record.exc_info = None
    return True


if __name__ == "__main__":
    start_logs("WARNING")
    for handler in logging.getLogger().handlers:
        handler.addFilter(_in_one_line)
    logging.getLogger("eskin.demo").setLevel(logging.INFO)
    uvloop.run(serve(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])))
