"""What is left after the fire: each block stored once, each gap explained, each sum right."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from demo.audit import audit
from eskin.messages import Gap, decode_message
from eskin.sequences import SequenceRanges
from tests.stores import ask_store

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cloud.store.place import Place
    from tests.chaos.plan import Stroke
    from tests.chaos.site import Site

_WHY: Final = {
    "sampling overrun": ("hang", "disk full"),
    "flash write failed": ("disk full",),
    "flash full": ("cut", "half open", "hang", "kill", "flood", "lossy", "reset", "disk full"),
}
"""Reason of a gap to the faults that can be behind it."""


@dataclass(slots=True)
class Verdict:
    """What was found.

    Attributes:
        made: Blocks that the nodes made.
        stored: Those in the store.
        told: Those that a gap tells as lost.
        unborn: Those that never came to be in flash: killed between truth and commit.
        gaps: Reason to how many gaps.
        samples: Samples that were compared with the truth.
        faults: What is wrong; empty if all is well.
    """

    made: int = 0
    stored: int = 0
    told: int = 0
    unborn: int = 0
    gaps: dict[str, int] = field(default_factory=dict)
    samples: int = 0
    faults: list[str] = field(default_factory=list)


def judge(site: Site, strokes: Iterable[Stroke]) -> Verdict:
    """Compare flash, truth and store of a site that has come to rest."""
    verdict = Verdict()
    _compare(site, verdict)
    explain(site.store, verdict, {stroke.fault for stroke in strokes})
    add_up(site.store, verdict)
    verdict.faults += [f"refused: {letter}" for letter in site.letters()]
    return verdict


def _compare(site: Site, verdict: Verdict) -> None:
    found = audit(site.layout, store=site.store)
    for delivery in found.deliveries:
        verdict.made += delivery.made
        verdict.stored += delivery.stored
        verdict.told += delivery.told
        verdict.unborn += delivery.unborn
        if delivery.missing:
            verdict.faults.append(
                f"{delivery.node}: {len(delivery.missing)} blocks vanished, the first at "
                f"{delivery.missing[0]}"
            )
        if delivery.waiting:
            verdict.faults.append(f"{delivery.node}: {delivery.waiting} blocks still wait")
    for channel in found.channels:
        verdict.samples += channel.samples
        if not channel.passes:
            verdict.faults.append(f"{channel.node}/{channel.channel}: broken promise")


def explain(store: Place, verdict: Verdict, happened: set[str]) -> None:
    """Find the fault behind each gap."""
    query = "SELECT detail, count(*) FROM events WHERE kind = 'gap' GROUP BY detail"
    for detail, count in ask_store(store, query):
        reason = next((why for why in _WHY if str(detail).startswith(why)), str(detail))
        verdict.gaps[reason] = verdict.gaps.get(reason, 0) + count
    for reason, count in verdict.gaps.items():
        if not happened.intersection(_WHY.get(reason, ())):
            verdict.faults.append(f"{count} gaps without a cause: {reason}")


def add_up(store: Place, verdict: Verdict) -> None:
    """Sums that are kept while blocks arrive must be those of the blocks: nothing counted twice.

    A row may hold several blocks, packed.
    """
    query = """
        SELECT c.node || '/' || c.channel, c.blocks, c.samples,
            coalesce(sum(CASE WHEN b.n IS NULL THEN 0 ELSE coalesce(b.packed, 1) END), 0),
            coalesce(sum(b.n), 0)
        FROM channels AS c LEFT JOIN blocks AS b ON b.node = c.node AND b.channel = c.channel
        GROUP BY c.node, c.channel
    """
    for place, blocks, samples, counted, summed in ask_store(store, query):
        if (blocks, samples) != (counted, summed):
            verdict.faults.append(
                f"{place}: {blocks} blocks and {samples} samples are told, "
                f"{counted} and {summed} are stored"
            )
    for (node, boot), ranges in _numbers(store).items():
        spans = list(ranges)
        if len(spans) != 1 or spans[0][0] != 0:
            verdict.faults.append(
                f"{node}: boot {boot} has holes: {len(spans)} ranges from {spans[0][0]}"
            )


def _numbers(store: Place) -> dict[tuple[str, int], SequenceRanges]:
    """By node and boot, the numbers of messages that came, or that a gap names as lost."""
    found: dict[tuple[str, int], SequenceRanges] = defaultdict(SequenceRanges)
    for node, boot, first, last in ask_store(
        store, "SELECT node, boot, first, last FROM sequences"
    ):
        found[node, boot].add(first, last)
    for node, data in ask_store(store, "SELECT node, data FROM events WHERE kind = 'gap'"):
        gap = decode_message(bytes(data))
        assert isinstance(gap, Gap)
        for boot, first, last in gap.lost:
            found[node, boot].add(first, last)
    return found
