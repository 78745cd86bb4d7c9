"""Faults: each is done to a part for a while, then taken back."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tests.robustness.chaos.part import Part


class Fault(Protocol):
    """Something that goes wrong."""

    def begin(self, part: Part) -> None:
        """Let it go wrong."""

    def end(self, part: Part) -> None:
        """Let it be right again."""


@dataclass(frozen=True, slots=True)
class Kill:
    """``kill -9``, and a new start; the broker also loses what it had on its disk.

    Attributes:
        only: Which of its processes; all else.
    """

    only: str = ""

    def begin(self, part: Part) -> None:
        """End it as a power cut would."""
        part.processes(self.only).kill()
        if part.name == "broker":
            (part.disk.folder / "mosquitto.db").unlink(missing_ok=True)

    def end(self, part: Part) -> None:
        """Start it again."""
        part.processes(self.only).start()


class Restart:
    """An operator's restart."""

    def begin(self, part: Part) -> None:
        """End it in good order."""
        part.running.terminate()

    def end(self, part: Part) -> None:
        """Wait for its end, and start it again."""
        part.running.stop(seconds=90)
        part.running.start()


@dataclass(frozen=True, slots=True)
class Hang:
    """SIGSTOP: its connections stay open, and it does not answer.

    Attributes:
        only: Which of its processes; all else.
    """

    only: str = ""

    def begin(self, part: Part) -> None:
        """Stop it."""
        part.processes(self.only).signal(signal.SIGSTOP)

    def end(self, part: Part) -> None:
        """Let it go on."""
        part.processes(self.only).signal(signal.SIGCONT)


class Cut:
    """The cable is pulled: connections stay half open."""

    def begin(self, part: Part) -> None:
        """Pull it."""
        part.host.pull()

    def end(self, part: Part) -> None:
        """Plug it in."""
        part.host.plug()


class HalfOpen:
    """It receives nothing, but sends: one side of each connection believes that all is well."""

    def begin(self, part: Part) -> None:
        """Make it deaf."""
        part.host.deafen()

    def end(self, part: Part) -> None:
        """Let it hear."""
        part.host.heal()


class Renewal:
    """Its certificates are renewed in mid-flow, each with a fresh key."""

    def begin(self, part: Part) -> None:
        """Renew them; a gateway's site, too."""
        for directory in part.identities:
            part.renew(directory)
        if part.name in {"broker", DATABASE}:
            part.running.signal(signal.SIGHUP)
        elif part.name in MEMBERS:
            part.processes("postgresql").signal(signal.SIGHUP)

    def end(self, part: Part) -> None:
        """Nothing is to be taken back."""


class Flood:
    """Killed, and flooded by rubbish as soon as it is back, beside all that waits."""

    def begin(self, part: Part) -> None:
        """End it as a power cut would."""
        part.running.kill()

    def end(self, part: Part) -> None:
        """Start it, and let the flood begin."""
        part.running.start()
        part.flood()


class Parrot:
    """The broker repeats whatever nodes and gateways said, several times and out of order."""

    def begin(self, part: Part) -> None:
        """Let it begin."""
        part.parrot.start()

    def end(self, part: Part) -> None:
        """Silence it."""
        part.parrot.kill()


@dataclass(frozen=True, slots=True)
class Lossy:
    """A share of the packets is lost, both ways."""

    share: float

    def begin(self, part: Part) -> None:
        """Lose them."""
        part.host.lose(self.share)

    def end(self, part: Part) -> None:
        """Lose none."""
        part.host.heal()


class Reset:
    """Every connection is reset."""

    def begin(self, part: Part) -> None:
        """Reset them."""
        part.host.reset()

    def end(self, part: Part) -> None:
        """Let them be."""
        part.host.heal()


class DiskFull:
    """Another process takes all of its disk."""

    def begin(self, part: Part) -> None:
        """Fill it."""
        part.disk.fill()

    def end(self, part: Part) -> None:
        """Free it."""
        part.disk.free()
        part.come_back()


@dataclass(frozen=True, slots=True)
class ClockJump:
    """Its clock is off for a while, and then right again: two jumps."""

    seconds: int

    def begin(self, part: Part) -> None:
        """Jump away."""
        assert part.clock is not None
        part.clock.set(self.seconds)

    def end(self, part: Part) -> None:
        """Jump back."""
        assert part.clock is not None
        part.clock.set(0)


class MoveShard:
    """A shard moves to it from another worker; the first time, it joins the cluster before."""

    def begin(self, part: Part) -> None:
        """Let it begin; it ends by itself, well or not."""
        part.take_shard()

    def end(self, part: Part) -> None:
        """Nothing is to be taken back."""


DATABASE: Final = "database"
"""Name of the part that is PostgreSQL, or the coordinator of Citus."""
WORKERS: Final = ("worker-1", "worker-2", "worker-3")
"""Names of the parts that are workers of Citus; the last one joins when a shard moves to it."""
MEMBERS: Final = ("database-1", "database-2")
"""Names of the parts that are Patroni and PostgreSQL, where these are a cluster."""

FAULTS: Final[Mapping[str, Fault]] = {
    "kill": Kill(),
    "restart": Restart(),
    "hang": Hang(),
    "cut": Cut(),
    "half open": HalfOpen(),
    "renewal": Renewal(),
    "flood": Flood(),
    "parrot": Parrot(),
    "lossy": Lossy(0.2),
    "reset": Reset(),
    "disk full": DiskFull(),
    "kill postgresql": Kill("postgresql"),
    "kill patroni": Kill("patroni"),
    "hang postgresql": Hang("postgresql"),
    "hang patroni": Hang("patroni"),
    "move shard": MoveShard(),
    "clock ahead": ClockJump(3600),
    "clock behind": ClockJump(-3600),
}
"""By the name under which a plan has them."""

EVERYWHERE: Final = (
    "kill", "restart", "hang", "cut", "half open", "lossy", "reset", "disk full", "renewal"
)  # fmt: skip
"""What can happen to every part."""
BROKER: Final = ("parrot",)
"""What can happen to the broker alone."""
GATEWAY: Final = ("flood",)
"""What can happen to gateways alone."""
MEMBER: Final = ("kill postgresql", "kill patroni", "hang postgresql", "hang patroni")
"""What can happen to members of the cluster alone."""
WORKER: Final = (
    "kill", "kill", "kill", "move shard", "move shard", "move shard", "hang", "restart", "disk full"
)  # fmt: skip
"""All that can happen to workers, which no network leads to; deaths and moves more often."""
TIMED: Final = ("clock ahead", "clock behind")
"""What can happen to parts whose time something rests on; not to broker and database."""
