"""The ``eskin`` command in a fork of the test's process: as real, without a second of imports."""

from __future__ import annotations

import io
import os
import sys
import tempfile
import traceback
from subprocess import CompletedProcess
from typing import IO, TYPE_CHECKING, NoReturn

import eskin_ca.service
import eskin_cloud.service
import eskin_gateway.service
import eskin_sensor_node.fleet

from eskin.cli import main
from tests.support.processes import wait_until
from tests.support.terminal import Terminal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["run", "run_before_people"]

# Each subcommand imports its tier when it runs; what is here already, no fork imports again.
_LOADED = (eskin_ca.service, eskin_cloud.service, eskin_gateway.service, eskin_sensor_node.fleet)


def run(*arguments: str, cwd: Path | None = None) -> CompletedProcess[str]:
    """Run the command; gives its status and what it wrote.

    A process of its own, with its own working folder, file descriptors and exit; only its modules
    are those that are loaded already.
    """
    with tempfile.TemporaryFile() as err:
        done = _run(arguments, cwd, err.fileno())
        return CompletedProcess(done.args, done.returncode, done.stdout, _text(err))


def run_before_people(*arguments: str) -> CompletedProcess[str]:
    """The same with a terminal for what it shows people: what it wrote there is all of it."""
    with Terminal() as terminal:
        done = _run(arguments, None, terminal.descriptor, look=terminal.look)
        return CompletedProcess(done.args, done.returncode, done.stdout, terminal.look())


def _run(
    arguments: tuple[str, ...], cwd: Path | None, err: int, *, look: Callable[[], str] = str
) -> CompletedProcess[str]:
    argv = ["eskin", *arguments]
    with tempfile.TemporaryFile() as out:
        child = os.fork()
        if child == 0:
            _become(argv, cwd, out.fileno(), err)
        status = _status(child, argv, look)
        return CompletedProcess(argv, status, _text(out))


def _become(argv: list[str], cwd: Path | None, out: int, err: int) -> NoReturn:
    """What the fork does; it never returns into the test."""
    status = 70
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        if os.isatty(2):
            os.environ["TERM"] = "xterm"
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(n, "w")) for n in (1, 2))
        sys.argv = argv
        if cwd is not None:
            os.chdir(cwd)
        main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 - a traceback is for the test to see
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _status(child: int, argv: list[str], look: Callable[[], str], *, seconds: float = 200.0) -> int:
    ended: list[int] = []

    def has_ended() -> bool:
        look()
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            ended.append(os.waitstatus_to_exitcode(status))
        return bool(ended)

    try:
        wait_until(has_ended, f"{' '.join(argv)} ends", seconds=seconds)
    except AssertionError:
        os.kill(child, 9)
        os.waitpid(child, 0)
        raise
    return ended[0]


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode()
