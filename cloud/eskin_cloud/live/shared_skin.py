"""The latest samples of a skin that several nodes share, each by its own clock."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from eskin.wire.frames.frame import FrameHead, read_head
from eskin_cloud.store.read.patch_runs import runs_of_frames

if TYPE_CHECKING:
    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.query.contacts import ContactSkin, Pressures
    from eskin_cloud.store.feed_entry import FeedEntry
    from eskin_cloud.store.patch_run import PatchRun

_PATIENCE: Final = 1_000_000_000
"""A patch whose samples are so much older than those of another is not waited for, in ns; or three
stretches, where that is longer."""
_PENDING: Final = 1024
_RUNS: Final = 256


class SharedSkin:
    """Samples of a skin, and the latest instant that all its nodes have certainly passed.

    `take` is called on the event loop, and `advance` in one thread at a time.

    Args:
        described: The layout that its nodes state.

    Attributes:
        layout: The layout's hash.
        heard: Nodes of the frames that were taken, with the cursor of the latest one.
    """

    def __init__(self, described: DescribedLayout) -> None:
        self.layout = described.hash
        self.heard: dict[str, int] = {}
        self._described = described
        self._pending: deque[tuple[FrameHead, bytes]] = deque(maxlen=_PENDING)
        self._runs: dict[int, list[PatchRun]] = {}
        self._t = 0

    def take(self, entry: FeedEntry) -> bool:
        """Take a frame; gives whether it is new, and of a page that its node samples."""
        if entry.frame is None or entry.cursor <= self.heard.get(entry.node, -1):
            return False
        head = read_head(entry.frame)
        if self._described.controllers[head.page] != entry.node:
            return False
        self.heard[entry.node] = entry.cursor
        self._pending.append((head, entry.frame))
        return True

    def advance(self, skin: ContactSkin) -> Pressures | None:
        """What may be known of each taxel at the latest instant, once in the longest stretch.

        Returns:
            ``None`` if there is no later instant than before.
        """
        while self._pending:
            self._add(*self._pending.popleft(), skin)
        if not self._runs:
            return None
        span = max(len(runs[-1].lo) * runs[-1].dt for runs in self._runs.values())
        ends = [self._end(number, runs[-1]) for number, runs in self._runs.items()]
        patience = max(_PATIENCE, 3 * span)
        passed = min(end for end in ends if end >= max(ends) - patience)
        t = passed // span * span
        if t <= self._t:
            return None
        self._t = t
        for runs in self._runs.values():
            # The last run stays: it says how far the patch has come.
            runs[:-1] = [run for run in runs[:-1] if _held_until(run) >= t]
        return skin.hold(self._described, self._runs, t, spread=True)

    def _add(self, head: FrameHead, frame: bytes, skin: ContactSkin) -> None:
        numbers = [each for each in self._described.page_ranges[head.page] if each in skin.places]
        row = {"boot": head.position.boot, "sequence": head.position.sequence, "data": frame}
        if not numbers:
            return
        for number, run in runs_of_frames([row], self._described, numbers):
            runs = self._runs.setdefault(number, [])
            runs.append(run)
            runs.sort(key=lambda each: (each.t, each.boot, each.sequence))
            del runs[:-_RUNS]

    def _end(self, number: int, run: PatchRun) -> int:
        """When the last row was sampled at the earliest: all that is not here yet is later."""
        skew = min(self._described.patches[number].skew, default=0)
        return run.t - run.error + (len(run.lo) - 1) * run.dt + skew


def _held_until(run: PatchRun) -> int:
    """How long the samples of a run may hold at most, skews aside, if there is no gap behind."""
    step = run.dt << max(run.strides, default=0)
    return run.t + run.error + len(run.lo) * run.dt + 2 * step
