"""What is left after the fire: each frame stored once, each gap explained, each sum right."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.demo.audit import audit
from eskin.wire.frames import Statements
from eskin.wire.messages import Kind, Position
from eskin.wire.messages.cbor_map import load
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.timestamp import SECOND
from tests.robustness.chaos.alarms import judge_alarms
from tests.robustness.chaos.citus import DistributedDatabase
from tests.robustness.chaos.site import NODES, SKIN
from tests.support.skin_watcher import Seen
from tests.support.stores import ask_store

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from eskin_cloud.store.location import StoreLocation

    from eskin.wire.frames import Gap
    from tests.robustness.chaos.plan import Blow
    from tests.robustness.chaos.site import Site

DRAIN_S: Final = 90.0
"""For so long nothing may arrive of what waits; so what is under way is no older after a fault."""
_FEW: Final = 5
"""Frames of those that are missing that are named."""
_SEEN_S: Final = 60.0
"""For so long the skin's viewer may be behind in the end."""
_HOUR_NS: Final = 3600 * SECOND
"""By so much the faults of clocks move them."""
_CLOCK_NS: Final = 2 * SECOND
"""By so much a node's time may differ from ours: what it lives after a restart begins a second
after the latest sample of before, however soon that was."""


@dataclass(frozen=True, slots=True)
class Cause:
    """What can be behind a gap.

    Attributes:
        faults: Which.
        behind: Whether they may befall what is behind the node, too: all that is no node.
        after_s: For how long they have an effect.
    """

    faults: tuple[str, ...]
    behind: bool = False
    after_s: float = 0.0

    def explains(self, gap: Lost, blow: Blow) -> bool:
        """Whether a blow fell on one of those, at the time of what was lost or soon before it."""
        near = blow.part == gap.node or (self.behind and blow.part not in NODES)
        until = blow.end + _CLOCK_NS + round(self.after_s * SECOND)
        # A node that started while its clock was an hour off lives in that hour.
        off = _HOUR_NS * round((gap.earliest - blow.begin) / _HOUR_NS)
        in_time = blow.begin - _CLOCK_NS <= gap.latest - off and gap.earliest - off <= until
        return blow.fault in self.faults and near and in_time


@dataclass(frozen=True, slots=True)
class Lost:
    """A gap in the store.

    Attributes:
        node: Whose.
        reason: Such as ``flash full``.
        earliest: UTC ns of what is missing.
        latest: Likewise.
    """

    node: str
    reason: str
    earliest: int
    latest: int


_WHY: Final[Mapping[str, Cause]] = {
    "sampling overrun": Cause(("hang", "disk full")),
    "flash write failed": Cause(("disk full",)),
    "flash full": Cause(
        ("cut", "half open", "hang", "kill", "flood", "lossy", "reset", "disk full"),
        behind=True,
        after_s=DRAIN_S,
    ),
}
"""By the reason of a gap."""


@dataclass(slots=True)
class Verdict:
    """What was found.

    Attributes:
        made: Frames that the nodes made.
        stored: Those in the store.
        stated: Those that a gap states as lost.
        unborn: Those that never came to be in flash: killed between truth and commit.
        gaps: Reason to how many gaps.
        samples: Samples that were compared with the truth.
        seen: Frames that the skin's viewer got.
        skipped: Frames that were stated to it as left out; ``None`` if their number was not.
        pages: Rounds of questions of a page that were answered.
        alarms: Alarms that were raised.
        deliveries: Times that a receiver took a change of one.
        moves: How many shards have moved, and how many moves broke off.
        faults: What is wrong; empty if all is well.
    """

    made: int = 0
    stored: int = 0
    stated: int = 0
    unborn: int = 0
    gaps: dict[str, int] = field(default_factory=dict)
    samples: int = 0
    seen: int = 0
    skipped: int | None = 0
    pages: int = 0
    alarms: int = 0
    deliveries: int = 0
    moves: tuple[int, int] = (0, 0)
    faults: list[str] = field(default_factory=list)


def judge(site: Site, blows: Sequence[Blow]) -> Verdict:
    """Compare flash, truth and store of a site that has come to rest."""
    verdict = Verdict()
    _compare(site, verdict)
    explain(site.store, verdict, blows)
    add_up(site.store, verdict)
    _watched(site, verdict)
    verdict.alarms, verdict.deliveries, wrong = judge_alarms(site.store, site.taken)
    verdict.faults += wrong
    if isinstance(site.database, DistributedDatabase):
        mover = site.database.mover
        verdict.moves = mover.moved, len(mover.failed)
        verdict.faults += site.database.wrong()
    verdict.faults += [f"refused: {letter}" for letter in site.letters()]
    return verdict


def _compare(site: Site, verdict: Verdict) -> None:
    found = audit(site.layout, store=site.store)
    for delivery in found.deliveries:
        verdict.made += delivery.made
        verdict.stored += delivery.stored
        verdict.stated += delivery.lost
        verdict.unborn += delivery.unborn
        if delivery.missing:
            verdict.faults.append(
                f"{delivery.node}: {len(delivery.missing)} frames vanished, the first at "
                f"{delivery.missing[0]}"
            )
        if delivery.waiting:
            verdict.faults.append(f"{delivery.node}: {delivery.waiting} frames still wait")
    for node, doubled in found.doubled.items():
        if doubled:
            verdict.faults.append(f"{node}: {len(doubled)} frames are stored twice: {doubled[0]}")
    verdict.faults += [f"damaged: {row}" for row in found.damaged]
    for channel in found.channels:
        verdict.samples += channel.samples
        if not channel.passes:
            verdict.faults.append(f"{channel.node}/{channel.channel}: broken promise")


def explain(store: StoreLocation, verdict: Verdict, blows: Sequence[Blow]) -> None:
    """Find the blow behind each gap: on its node or behind it, at its time or soon before."""
    for gap in _gaps(store):
        verdict.gaps[gap.reason] = verdict.gaps.get(gap.reason, 0) + 1
        cause = _WHY.get(gap.reason)
        if cause is None or not any(cause.explains(gap, blow) for blow in blows):
            verdict.faults.append(_shown(gap, blows))


def _gaps(store: StoreLocation) -> Iterable[Lost]:
    query = "SELECT node, detail, t_lo, t_hi FROM events WHERE kind = 'gap' ORDER BY t_lo"
    for node, detail, earliest, latest in ask_store(store, query):
        reason = next((why for why in _WHY if str(detail).startswith(why)), str(detail))
        yield Lost(node, reason, earliest, latest)


def _shown(gap: Lost, blows: Sequence[Blow]) -> str:
    """A gap that nothing explains, its time in seconds after the first blow."""
    start = min((blow.begin for blow in blows), default=gap.earliest)
    first, last = ((time - start) / SECOND for time in (gap.earliest, gap.latest))
    return f"{gap.node}: gap without a cause, from {first:.1f} to {last:.1f} s: {gap.reason}"


def add_up(store: StoreLocation, verdict: Verdict) -> None:
    """Sums that are kept while frames arrive must be those of the frames: none counted twice."""
    query = """
        SELECT p.node, p.page, max(p.frames), max(p.samples), count(f.sequence),
            coalesce(sum(f.samples), 0)
        FROM pages AS p LEFT JOIN frames AS f
            ON f.slot = p.slot AND f.node = p.node AND f.layout = p.layout AND f.page = p.page
        GROUP BY p.node, p.layout, p.page
    """
    for node, page, total, samples, counted, summed in ask_store(store, query):
        if (total, samples) != (counted, summed):
            verdict.faults.append(
                f"{node}: page {page} has {counted} frames and {summed} samples, "
                f"{total} and {samples} by its totals"
            )
    for (node, boot), ranges in _numbers(store).items():
        spans = list(ranges)
        if len(spans) != 1 or spans[0][0] != 0:
            verdict.faults.append(
                f"{node}: boot {boot} has holes: {len(spans)} ranges from {spans[0][0]}"
            )


def _watched(site: Site, verdict: Verdict) -> None:
    """The skin's viewer and its page are answered, and see what is stored and nothing else.

    The viewer loses its stream with each fault of its cloud, and goes on where it was.
    """
    watcher, deadline = site.watcher, time.monotonic() + _SEEN_S
    made = GroundTruth.positions(site.layout.truth(SKIN))
    stored = site.numbers(SKIN), site.unwatched
    while left_out(seen := Seen.read(site.seen), made, *stored) and time.monotonic() < deadline:
        time.sleep(0.5)
    verdict.skipped = seen.skipped
    if missing := left_out(seen, made, *stored):
        first = ", ".join(f"{each.boot}:{each.sequence}" for each in missing[:_FEW])
        verdict.faults.append(
            f"{SKIN}: {len(missing)} stored frames were not seen, and {seen.skipped} were stated "
            f"as left out; the first are {first}"
        )
    if watcher is None or watcher.process is None or watcher.process.poll() is not None:
        said = "" if watcher is None else watcher.output()[-1000:]
        verdict.faults.append(f"{SKIN}: its watcher has ended: {said}")
    verdict.seen, verdict.pages = len(seen.frames), seen.pages
    verdict.faults += seen.wrong
    if not seen.frames or not seen.pages:
        verdict.faults.append(f"{SKIN}: {len(seen.frames)} frames and {seen.pages} pages were seen")
    numbers = _numbers(site.store)
    lacking = [place for place in seen.frames if place[1] not in numbers[SKIN, place[0]]]
    if lacking:
        verdict.faults.append(f"{SKIN}: {len(lacking)} frames were seen and are not stored")


def left_out(
    seen: Seen,
    made: Iterable[Position],
    stored: Mapping[int, SequenceRanges],
    before: Mapping[int, SequenceRanges],
) -> list[Position]:
    """Frames that a viewer neither got nor was stated to have missed, oldest first.

    Args:
        seen: What it saw.
        made: The frames that the node made.
        stored: By boot, the numbers of the messages that are stored.
        before: Those that were stored when it had begun.
    """
    got, none = set(seen.frames), SequenceRanges()
    places = ((each.boot, each.sequence) for each in made)
    missing = [
        Position(boot, number)
        for boot, number in sorted(places)
        if (boot, number) not in got
        and number in stored.get(boot, none)
        and number not in before.get(boot, none)
    ]
    return [] if seen.skipped is None or len(missing) <= seen.skipped else missing


def _numbers(store: StoreLocation) -> dict[tuple[str, int], SequenceRanges]:
    """By node and boot, the numbers of messages that came, or that a gap names as lost."""
    found: dict[tuple[str, int], SequenceRanges] = defaultdict(SequenceRanges)
    for node, boot, first, last in ask_store(
        store, "SELECT node, boot, first, last FROM sequences"
    ):
        found[node, boot].add(first, last)
    # Of statements, the first row holds the message, whatever it is about.
    query = """
        SELECT e.node, e.data FROM events AS e WHERE e.data IS NOT NULL AND EXISTS (
            SELECT 1 FROM events AS g WHERE g.kind = 'gap' AND g.slot = e.slot AND g.node = e.node
            AND g.boot = e.boot AND g.sequence = e.sequence)
    """
    for node, data in ask_store(store, query):
        for gap in _stated(bytes(data)):
            for boot, first, last in gap.lost:
                found[node, boot].add(first, last)
    return found


def _stated(data: bytes) -> Sequence[Gap]:
    """The gaps that a message states."""
    fields = load(data)
    if fields.integer(1, 0, 255) != Kind.STATEMENTS:
        return ()
    return Statements.read(fields).gaps
