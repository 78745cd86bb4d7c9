"""Samples a skin over its scenario as fast as possible, and counts the node's work."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Final

from eskin.interval import Interval
from eskin.wire.frames import Frame, PatchSamples
from eskin.wire.messages import Position
from eskin_sensor_node.columns import build
from eskin_sensor_node.machine.ledger import OVERHEAD
from eskin_sensor_node.machine.prices import ENVELOPE, NONE, stretch
from eskin_sensor_node.machine.work_counters import WorkCounters
from eskin_sensor_node.node.factory import build_clock
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_sensor_node.columns import PadColumns, SkinStretch
    from eskin_sensor_node.settings import NodeSettings

TRANSPORT: Final = 80
"""MQTT's PUBLISH with its topic, and a TLS record."""
ANSWER: Final = 40
"""PUBACK in a TLS record, and a share of the gateway's acknowledgement of many messages."""


def skin_work(
    settings: NodeSettings, seconds: int, progress: Callable[[int], None]
) -> WorkCounters:
    """What a skin's node does in some emulated seconds: it sends each sample, in frames.

    Args:
        settings: The node's.
        seconds: How long.
        progress: Takes how many emulated seconds have passed since it was called.
    """
    section, seed = settings.skin, settings.node.seed or 0
    clock = build_clock(settings, seed=seed, boot=0, start=0, monotonic=lambda: 0)
    columns = build(settings, seed, boot=0, clock=clock)
    along = [each.chain for each in section.air.values()]
    taxels, cycles, counts = len(columns.columns), NONE, WorkCounters()
    for second in range(1, seconds + 1):
        for each in columns.advance(second * BILLION):
            rows, sizes = each.grids[0].rows, list(_frames(columns, each))
            done = stretch(
                settings.machine.processor,
                section.taxel.chain,
                taxels=taxels,
                rows=rows,
                neighbours=section.skin.neighbours.shape[1],
                along=along,
                sizes=sizes,
            )
            cycles = cycles.plus(done.total)
            counts = counts._replace(
                conversions=counts.conversions + rows * (taxels + len(along)),
                sent=counts.sent + sum(sizes) + len(sizes) * (ENVELOPE + TRANSPORT),
                received=counts.received + len(sizes) * ANSWER,
                written=counts.written + sum(sizes) + len(sizes) * OVERHEAD,
                wakes=counts.wakes + rows,
            )
        progress(1)
    span = seconds * BILLION
    return counts._replace(
        cycles=cycles.most,
        fewest=cycles.least,
        # A cycle's energy is what such a machine takes on top of its power at rest.
        asleep=span,
        on=span,
        span=span,
    )


def _frames(columns: PadColumns, stretch: SkinStretch) -> Iterator[int]:
    """Bytes of each frame of a stretch."""
    layout = columns.layout
    edges = accumulate(layout.pages, initial=0)
    for page, (begin, end) in enumerate(pairwise(edges)):
        patches = tuple(
            PatchSamples.pack(
                Interval(each.lo, each.hi),
                columns.patches[each.patch].least_width,
                patch=each.patch,
                grid=each.grid,
                first_row=stretch.grids[each.grid].first_row,
            )
            for each in stretch.patches
            if begin <= each.patch < end
        )
        if patches:
            times = stretch.begin, stretch.end
            frame = Frame(
                Position(0, 0),
                layout.content_hash,
                page,
                stretch.begin,
                times,
                tuple(stretch.grids),
                patches,
            )
            yield len(frame.encode())
