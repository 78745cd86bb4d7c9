"""Nodes and taxels for tests: packaged designs with some settings changed."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.kinds.registry import Taxel
from eskin_sensor_node.machine.clock import Clock
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.machine.radio import Radio
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.node.node import Node
from eskin_sensor_node.profile import Profile
from eskin_sensor_node.settings import NodeSettings
from pydantic import TypeAdapter

from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.traffic import Traffic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import ModuleType

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.flash.flash import Partition

START = 1_790_000_000_000_000_000
SECOND = 1_000_000_000

KINDS = {
    "capacitive": ("fingertip", 0),
    "touch": ("palm", 0),
    "inductive": ("forearm", 0),
    "hybrid": ("forearm", 1),
    "pad": ("hand", 0),
    "coil": ("hand", 14),
    "thermometer": ("hand", 16),
    "hygrometer": ("hand", 17),
    "bioelectric": ("hand", 18),
}


SMALL = frozenset({"fingertip", "palm", "forearm", "hand"})
"""Profiles whose stretch is the default."""
STRETCH_MS = 50.0
"""Of nodes of the tests: half of the default, so that a second has twice as many frames."""


def table(kind: str, /, **changes: Any) -> dict[str, Any]:
    """The ``[[taxel]]`` table of a packaged taxel, changed."""
    profile, number = KINDS[kind]
    return {**Profile.read(profile).taxels[number], **changes}


def taxel(kind: str, /, **changes: Any) -> TaxelSection:
    """A packaged taxel, changed."""
    found: TaxelSection = TypeAdapter(Taxel).validate_python(table(kind, **changes))
    return found


def settings(folder: Path, profile: str = "fingertip", **sections: Any) -> NodeSettings:
    """Settings of a node that lives in a folder."""
    given: dict[str, Any] = {
        "identity": {"directory": folder, "site": folder / "site.pem"},
        "flash": {"path": folder / "flash.sqlite"},
        "truth": {"path": folder / "truth.sqlite"},
        **sections,
    }
    if profile in SMALL:
        given["sampling"] = {"stretch_ms": STRETCH_MS} | sections.get("sampling", {})
    given["node"] = {"name": profile, "profile": profile, "seed": 7} | sections.get("node", {})
    return NodeSettings(**given)


def clock_at(
    ticks: Callable[[], int], *, rtc_error: int = 2_000_000, drift: int = 0, seed: int = 3
) -> Clock:
    """A clock of which the test turns the hands."""
    return Clock(
        start=START,
        monotonic=ticks,
        speed=1.0,
        rtc_error=rtc_error,
        drift=drift,
        seed=seed,
        boot=1,
    )


def waiting(flash: Partition) -> list[StoredMessage]:
    """All that waits on a flash, unread."""
    return flash.after((-1, -1), 1_000_000)


class Bench:
    """A node without a network, whose time the test turns."""

    def __init__(
        self,
        folder: Path,
        profile: str = "fingertip",
        *,
        drift: int = 0,
        functions: ModuleType = inversion,
        **sections: Any,
    ) -> None:
        self.settings = settings(folder, profile, **sections)
        self.truth = GroundTruth(self.settings.truth.path, limit=self.settings.truth.limit_bytes)
        self.flash = open_flash(self.settings.flash.path)
        self.outbox = build_outbox(
            self.flash,
            capacity=self.settings.flash.capacity_bytes,
            broker=self.settings.broker,
            described=plan_layout(self.settings).described,
        )
        self.traffic = Traffic()
        self.ticks = 0
        self.clock = clock_at(lambda: self.ticks, drift=drift)
        self.node = Node(
            self.settings,
            clock=self.clock,
            outbox=self.outbox,
            truth=self.truth,
            seed=7,
            functions=functions,
        )

    def run_to(self, seconds: float) -> None:
        """Let time pass in tenths of a second, without an overrun."""
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + SECOND // 10, end)
            self.node.advance(self.ticks)

    def radio(self) -> Radio:
        """Air, in real time."""
        return Radio(
            self.settings.radio,
            now=time.monotonic_ns,
            random=np.random.default_rng(5),
            meter=self.traffic,
        )

    def bodies(self) -> Iterator[bytes]:
        """All waiting messages."""
        return (kept.body for kept in waiting(self.flash))

    def close(self) -> None:
        self.flash.close()
        self.truth.close()
