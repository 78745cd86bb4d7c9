"""A container engine of the tests' own, and the image that takes the place of the official one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING

from tests.support.processes import Running

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

BASE_IMAGE = "eskin-base"
_SOCKET = Path("/var/run/docker.sock")
_CA_BUNDLE = "/etc/ssl/certs/ca-certificates.crt"
_MEMORY = Path("/dev/shm")  # noqa: S108 - only its room and its kind matter
_MEMORY_BYTES = 8 * 2**30


@contextmanager
def container_engine() -> Iterator[dict[str, str]]:
    """An engine; gives the environment that makes docker and docker-compose use it.

    An engine that the user has (``DOCKER_HOST``, or the usual socket) is taken as it is. Otherwise
    one is started, as root, in a folder that goes with it.
    """
    if "DOCKER_HOST" in os.environ or _SOCKET.exists():
        yield dict(os.environ)
        return
    assert os.geteuid() == 0, "an engine can be started by root alone; or name yours: DOCKER_HOST"
    folder = Path(mkdtemp(prefix="eskin-engine-", dir=_in_memory()))
    address = f"unix://{folder / 'socket'}"
    environment = {
        **os.environ,
        "PATH": f"{os.environ['PATH']}:/usr/sbin:/sbin",
        "DOCKER_HOST": address,
        "BASE_IMAGE": BASE_IMAGE,
    }
    daemon = Running(
        [
            *("dockerd", "--host", address, "--data-root", str(folder / "data")),
            *("--exec-root", str(folder / "exec"), "--pidfile", str(folder / "pid")),
            *("--mtu", str(_mtu())),
        ],
        log=folder / "log",
        env=environment,
    )
    # Ending the tests ends the engine, too.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    with _forwarding_as_before(environment), daemon:
        try:
            daemon.wait_for(lambda: "API listen on" in daemon.output(), "the engine listens")
            _import_base(folder, environment)
            yield environment
        finally:
            daemon.stop(seconds=60)
            shutil.rmtree(folder)
            signal.signal(signal.SIGTERM, before)


def run(
    argv: Sequence[str], environment: Mapping[str, str], *, seconds: float, errors: bool = True
) -> str:
    """Run a command to its end; gives its output.

    Args:
        argv: The command.
        environment: All of it.
        seconds: How long it may take.
        errors: Whether its error output counts as output.
    """
    try:
        done = subprocess.run(
            argv,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT if errors else subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        raise AssertionError(f"{argv} not done after {seconds:g} s:\n{late.output}") from late
    output = done.stdout + (done.stderr or "")
    assert done.returncode == 0, f"{argv} ended with {done.returncode}:\n{output[-5000:]}"
    return done.stdout


@contextmanager
def _forwarding_as_before(environment: Mapping[str, str]) -> Iterator[None]:
    """Give back what an engine takes over: whether and how this machine forwards packets."""
    switch = Path("/proc/sys/net/ipv4/ip_forward")
    forwards = switch.read_text()
    policy = run(["iptables", "-S", "FORWARD"], environment, seconds=20).splitlines()[0].split()
    try:
        yield
    finally:
        run(["iptables", *policy], environment, seconds=20)
        switch.write_text(forwards)


def _import_base(folder: Path, environment: Mapping[str, str]) -> None:
    """Make a Debian with Python: no registry can be reached to pull one from."""
    root = folder / "base"
    packages = "python3,python3-venv,ca-certificates"
    run(
        ["debootstrap", "--variant=minbase", f"--include={packages}", "bookworm", str(root)],
        environment,
        seconds=600,
    )
    # Package registries may be known to this machine by a CA of its own.
    shutil.copy(os.environ.get("SSL_CERT_FILE", _CA_BUNDLE), f"{root}{_CA_BUNDLE}")
    archive = folder / "base.tar"
    run(["tar", "-C", str(root), "-cf", str(archive), "."], environment, seconds=120)
    changes = [f"ENV {name}={_CA_BUNDLE}" for name in ("PIP_CERT", "NODE_EXTRA_CA_CERTS")]
    options = [word for change in changes for word in ("--change", change)]
    run(["docker", "import", *options, str(archive), BASE_IMAGE], environment, seconds=120)
    archive.unlink()
    shutil.rmtree(root)


def _in_memory() -> Path | None:
    """Where there is plenty of memory: an engine writes gigabytes that go with it minutes later."""
    if not _MEMORY.is_dir() or shutil.disk_usage(_MEMORY).free < _MEMORY_BYTES:
        return None
    unfit = os.statvfs(_MEMORY).f_flag & (os.ST_NODEV | os.ST_NOEXEC)
    return None if unfit else _MEMORY


def _mtu() -> int:
    """Of the interface to the world: an engine's packets must not be larger."""
    for line in Path("/proc/net/route").read_text().splitlines()[1:]:
        interface, destination, *_ = line.split()
        if destination == "00000000":
            return int(Path(f"/sys/class/net/{interface}/mtu").read_text())
    return 1500
