"""The firmware, run over its scenario as fast as it can, and what it did."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.privacy.subject import KEY_BYTES
from sensor_node.budget.traffic import received_for, sent_for
from sensor_node.flash import Flash
from sensor_node.machine.clock import Clock
from sensor_node.machine.compilation import compiled_inversion
from sensor_node.machine.crystal import BILLION, Crystal
from sensor_node.node import Node
from sensor_node.service import build_outbox
from sensor_node.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Callable

    from sensor_node.firmware.outbox import Outbox
    from sensor_node.machine.ledger import Ledger
    from sensor_node.machine.work import Work
    from sensor_node.settings import NodeSettings

_STEP: Final = 5
"""Emulated seconds between two looks at flash."""
Progress: TypeAlias = "Callable[[int], None]"
_START: Final = 1_790_000_000 * BILLION
"""Any moment: nothing of a budget depends on it."""


def work_of(
    settings: NodeSettings, mode: str, seconds: int, progress: Callable[[int], None]
) -> Work:
    """What one node does in some emulated seconds.

    Args:
        settings: The node's; no load is shed.
        mode: Of all its taxels: ``samples``, ``adaptive`` or ``peaks``.
        seconds: How long.
        progress: Takes how many emulated seconds have passed since it was called.
    """
    unlimited = settings.model_copy(
        update={"energy": settings.energy.model_copy(update={"on": False})}
    )
    with tempfile.TemporaryDirectory() as folder:
        truth = Truth(Path(folder) / "truth.sqlite", limit=2**24)
        flash = Flash(
            Path(folder) / "flash.sqlite", node=settings.node.name, key=os.urandom(KEY_BYTES)
        )
        try:
            return _run(unlimited, (flash, truth), mode, seconds, progress)
        finally:
            flash.close()
            truth.close()


def _run(
    settings: NodeSettings,
    kept: tuple[Flash, Truth],
    mode: str,
    seconds: int,
    progress: Progress,
) -> Work:
    flash, truth = kept
    seed = truth.seed(settings.node.seed)
    now = 0
    clock = _clock(lambda: now, seed)
    outbox = build_outbox(flash, capacity=2**30, broker=settings.broker)
    node = Node(
        settings,
        clock=clock,
        outbox=outbox,
        truth=truth,
        seed=seed,
        functions=compiled_inversion(),
    )
    for taxel in node.taxels:
        taxel.control_unit.mode = mode
        taxel.control_unit.calibrate()
    ledger = node.machine.ledger
    second = told = 0
    while second < seconds:
        passed = min(_STEP, seconds - second)
        second += passed
        now = second * BILLION
        node.run_until(now)
        if second >= told:
            node.record_status()
            told += round(settings.broker.status_s)
        _send(flash, outbox, ledger)
        progress(passed)
    return ledger.take(node.machine.now)


def _send(flash: Flash, outbox: Outbox, ledger: Ledger) -> None:
    """All that waits goes out once, and is acknowledged."""
    waiting = flash.after((-1, -1), 1_000_000)
    for kept in waiting:
        ledger.sent += sent_for(kept)
        ledger.received += received_for(kept)
    outbox.acknowledge([(boot, number, number) for boot, number in (k.position for k in waiting)])


def _clock(now: Callable[[], int], seed: int) -> Clock:
    """A right clock, whose time is the machine's."""
    random = np.random.default_rng(seed)
    return Clock(
        start=_START,
        monotonic=now,
        speed=1.0,
        rtc_error=0,
        drift=0,
        crystal=Crystal(0, random),
        random=random,
    )
