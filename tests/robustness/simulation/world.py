"""One run: two nodes, a broker, two gateways and a cloud, from start to rest."""

from __future__ import annotations

import logging
import shutil
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.robustness.simulation.broker import Broker
from tests.robustness.simulation.cloud import Cloud
from tests.robustness.simulation.faults import ACTIVE_S, CLOUD, GATEWAYS, NODES, Fault, Faults
from tests.robustness.simulation.gateway import Gateway
from tests.robustness.simulation.laws import LawError, Laws
from tests.robustness.simulation.node import Node
from tests.robustness.simulation.timeline import EPOCH, Timeline

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.robustness.simulation.parties import Parties

_LONGEST_S: Final = 240.0
"""Seconds after the last fault within which all must have arrived."""


@dataclass(slots=True)
class Run:
    """What a run came to.

    Attributes:
        seed: Its seed.
        faults: Its faults.
        broken: The law that was broken; ``None``: all held.
        history: What happened, a line each; the last one has the digest of the store.
        steps: Actions.
        messages: Messages that nodes made.
        simulated_s: Simulated seconds.
        seconds: Real ones.
    """

    seed: int
    faults: Sequence[Fault]
    broken: str | None = None
    history: list[str] = field(default_factory=list)
    steps: int = 0
    messages: int = 0
    simulated_s: float = 0.0
    seconds: float = 0.0


class World:
    """All parts.

    Args:
        seed: Of all draws.
        chosen: Faults that happen.
        parties: Identities.
        folder: Of all files.

    Attributes:
        wearers: Pseudonym of the subject that wears each node.
        erased: Pseudonyms of erased subjects.
    """

    def __init__(self, seed: int, chosen: Sequence[Fault], parties: Parties, folder: Path) -> None:
        self.parties = parties
        self.timeline = Timeline(seed)
        self.faults = Faults(self.timeline, chosen)
        self.wearers: dict[str, str] = {}
        self.erased: set[str] = set()
        self.laws = Laws(self)
        self.broker = Broker(self)
        self.gateways: list[Gateway] = []
        self.cloud = Cloud(self)
        self.gateways += [Gateway(self, name, folder) for name in GATEWAYS]
        for node in NODES:
            self._wear(node)
        self.nodes = [Node(self, name, folder) for name in NODES]
        for fault in chosen:
            self._schedule(fault)

    def node(self, name: str) -> Node:
        """The node with a name."""
        return self.nodes[NODES.index(name)]

    def _wear(self, node: str) -> None:
        """Give a node a subject that wears it from now on."""
        some = self.gateways[0]
        since = EPOCH + self.timeline.now
        subject = some.keystore.create()
        some.assignments.assign(node, subject, since=since)
        self.wearers[node] = subject.pseudonym

    def _schedule(self, fault: Fault) -> None:
        """Schedule what a fault does by itself; others strike where they are asked for."""
        actions: dict[str, Callable[[], None]]
        if fault.part == CLOUD:
            actions = {"dies": lambda: self.cloud.die(fault.lasts)}
        elif fault.part in GATEWAYS:
            gateway = self.gateways[GATEWAYS.index(fault.part)]
            actions = {"dies": lambda: gateway.die(fault.lasts)}
        else:
            node = self.node(fault.part)
            actions = {
                "disconnects": lambda: node.disconnect(fault.lasts),
                "is reset": node.reset,
                "loses power": lambda: node.lose_power(fault.lasts),
                "measures much": node.measure_much,
                "has its subject erased": lambda: self._erase(fault.part),
            }
        if fault.kind in actions:
            self.timeline.after(fault.at, actions[fault.kind])

    def _erase(self, node: str) -> None:
        """Erase the subject that wears a node; another one wears it from then on."""
        some = self.gateways[0]
        pseudonym = self.wearers[node]
        self.timeline.note(node, "has its subject erased")
        self.erased.add(pseudonym)
        some.keystore.shred(pseudonym)
        self._wear(node)

    def run(self) -> None:
        """Run until all rests.

        Raises:
            LawError: A law is broken.
        """
        self.timeline.elapse(ACTIVE_S + 0.1)
        until = self.timeline.now / 1e9 + _LONGEST_S
        while not self._rests():
            if self.timeline.now / 1e9 > until:
                raise LawError(f"something still waits after {_LONGEST_S:g} s: {self._waiting()}")
            self.timeline.elapse(0.5)
        # Jobs of the cloud look once more.
        self.timeline.elapse(4.0)
        self.laws.check_all()
        self.timeline.note("all", f"rest: {self.laws.digest()}")

    def _rests(self) -> bool:
        return self.cloud.running and not any(self._waiting().values())

    def _waiting(self) -> dict[str, float]:
        return {
            **{node.name: node.waiting for node in self.nodes},
            **{gateway.name: gateway.waiting for gateway in self.gateways},
            **{f"erasures of {gateway.name}": gateway.erasures for gateway in self.gateways},
        }

    def close(self) -> None:
        """Close all files."""
        self.laws.close()
        for node in self.nodes:
            node.close()
        for gateway in self.gateways:
            gateway.close()
        self.cloud.close()


def simulate(seed: int, faults: Sequence[Fault], parties: Parties) -> Run:
    """Run once.

    Args:
        seed: Of all draws.
        faults: Those that happen.
        parties: Identities.
    """
    run = Run(seed, faults)
    begun = time.monotonic()
    logging.disable(logging.CRITICAL)
    folder = Path(tempfile.mkdtemp(dir=parties.folder))
    try:
        world = World(seed, faults, parties, folder)
        try:
            world.run()
        except LawError as error:
            run.broken = str(error)
        finally:
            world.close()
        run.history = world.timeline.history
        run.steps = world.timeline.steps
        run.messages = sum(len(node.made) for node in world.nodes)
        run.simulated_s = world.timeline.now / 1e9
    finally:
        logging.disable(logging.NOTSET)
        shutil.rmtree(folder)
    run.seconds = time.monotonic() - begun
    return run
