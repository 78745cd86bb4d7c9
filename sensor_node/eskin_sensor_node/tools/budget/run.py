"""Runs the firmware over its scenario as fast as possible, and counts its work."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

from eskin_sensor_node.machine.prices import ENVELOPE
from eskin_sensor_node.node.offline import offline_node
from eskin_sensor_node.timebase import BILLION
from eskin_sensor_node.tools.budget.skin_work import ANSWER, TRANSPORT, skin_work

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.machine.work_counters import WorkCounters
    from eskin_sensor_node.node.offline import OfflineNode
    from eskin_sensor_node.settings import NodeSettings

_STEP: Final = 5
"""Emulated seconds between two deliveries."""
Progress: TypeAlias = "Callable[[int], None]"


def work_of(
    settings: NodeSettings, mode: str, seconds: int, progress: Callable[[int], None]
) -> WorkCounters:
    """What one node does in some emulated seconds.

    Args:
        settings: The node's; no load is shed.
        mode: Of all its taxels: ``samples``, ``adaptive`` or ``peaks``.
        seconds: How long.
        progress: Takes how many emulated seconds have passed since it was called.
    """
    if settings.skin.present:
        return skin_work(settings, seconds, progress)
    with offline_node(settings) as offline:
        return _run(offline, settings, mode, seconds, progress)


def _run(
    offline: OfflineNode,
    settings: NodeSettings,
    mode: str,
    seconds: int,
    progress: Progress,
) -> WorkCounters:
    node = offline.node
    for taxel in node.taxels:
        taxel.control_unit.mode = mode
        taxel.control_unit.calibrate()
    second = next_status = 0
    while second < seconds:
        passed = min(_STEP, seconds - second)
        second += passed
        offline.run_until(second * BILLION)
        if second >= next_status:
            node.record_status()
            next_status += round(settings.broker.status_s)
        _send(offline)
        progress(passed)
    return node.machine.ledger.take(node.machine.now)


def _send(offline: OfflineNode) -> None:
    """Send all that waits once, and acknowledge it."""
    ledger = offline.node.machine.ledger
    waiting = offline.flash.after((-1, -1), 1_000_000)
    for kept in waiting:
        ledger.sent += sent_for(kept)
        ledger.received += ANSWER
    offline.outbox.acknowledge(
        [(boot, number, number) for boot, number in (k.position for k in waiting)]
    )


def sent_for(kept: StoredMessage) -> int:
    """Bytes sent for a message that needs no repeat."""
    return len(kept.body) + ENVELOPE + TRANSPORT
