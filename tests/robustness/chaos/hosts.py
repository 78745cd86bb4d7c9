"""Hosts: network namespaces on one bridge, whose cables can be pulled, lossy, or deaf.

All of it lies in the network and mount namespace of the process that calls, which `unshare` has
made for it: nothing outlives it, and nothing outside is touched.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Final

_BRIDGE: Final = "switch"
_NETWORK: Final = "10.99.0"


class Host:
    """A network namespace with one interface.

    Args:
        name: Such as ``cloud``; at most 12 letters.
        number: Last part of its address.

    Attributes:
        address: Its IPv4 address.
    """

    def __init__(self, name: str, number: int) -> None:
        self.name = name
        self.address = f"{_NETWORK}.{number}"
        self._cable = f"c-{name}"
        _ip("netns", "add", name)
        _ip("link", "add", self._cable, "type", "veth", "peer", "name", "eth0", "netns", name)
        _ip("link", "set", self._cable, "master", _BRIDGE, "up")
        for words in (
            ("addr", "add", f"{self.address}/24", "dev", "eth0"),
            ("link", "set", "eth0", "up"),
            ("link", "set", "lo", "up"),
        ):
            _ip("-n", name, *words)

    @property
    def prefix(self) -> list[str]:
        """Words before a command that shall run here."""
        return ["ip", "netns", "exec", self.name]

    def pull(self) -> None:
        """Pull the cable: connections stay half open at both ends."""
        _ip("link", "set", self._cable, "down")

    def plug(self) -> None:
        """Plug it in again."""
        _ip("link", "set", self._cable, "up")

    def lose(self, share: float) -> None:
        """Drop a share of the packets that come in, and of those that go out."""
        # Only what the cable carries: paho talks to itself over loopback.
        for chain, cable in (("INPUT", "-i"), ("OUTPUT", "-o")):
            random = ("-m", "statistic", "--mode", "random", "--probability", f"{share:.3f}")
            self._filter("-A", chain, cable, "eth0", *random, "-j", "DROP")

    def reset(self) -> None:
        """Answer whatever comes over TCP with a reset."""
        reject = ("-i", "eth0", "-p", "tcp", "-j", "REJECT", "--reject-with", "tcp-reset")
        self._filter("-A", "INPUT", *reject)

    def deafen(self) -> None:
        """Drop whatever comes in; what goes out still arrives."""
        self._filter("-A", "INPUT", "-i", "eth0", "-j", "DROP")

    def heal(self) -> None:
        """Let everything through again."""
        self._filter("-F")

    def _filter(self, *words: str) -> None:
        _run(*self.prefix, "iptables", "-w", *words)


def make_switch() -> None:
    """Make the bridge to which hosts are plugged, in namespaces of our own."""
    folder = Path("/run/netns")
    folder.mkdir(exist_ok=True)
    _run("mount", "-t", "tmpfs", "tmpfs", str(folder))
    _ip("link", "add", _BRIDGE, "type", "bridge")
    _ip("link", "set", _BRIDGE, "up")


def _ip(*words: str) -> None:
    _run("ip", *words)


def _run(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()}")
