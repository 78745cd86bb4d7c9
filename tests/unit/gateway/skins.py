"""Skins of nodes for the gateway's tests, and what they send of them."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.wire import frames
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples, Privacy, Statements
from eskin.wire.messages import Position
from eskin.wire.topics import Stream
from tests.support.processes import wait_until
from tests.unit.gateway.messages import EPOCH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from tests.unit.gateway.wire_node import WireNode

PERIOD = 20_000_000


def patch(number: int, columns: int, *, threshold: float | None = 3e3) -> Patch:
    """A patch of pressures."""
    taxels = tuple(f"p{number:03d}c{column:02d}" for column in range(columns))
    return Patch(f"pad{number:03d}", "pressure", "Pa", taxels, 64.0, threshold=threshold)


WEARER = Patch("skin", "bioelectric", "V", ("b01",), 1e-5, Privacy.BIOMETRIC, "wearer")


class SkinOf:
    """A layout with its patches.

    Attributes:
        patches: Its patches.
        layout: Its layout, all patches but the last on one page.
    """

    def __init__(self, *patches: Patch, pages: Sequence[int] = ()) -> None:
        self.patches = patches
        self.layout = Layout(
            tuple(each.content_hash for each in patches), tuple(pages) or (len(patches),)
        )

    @property
    def descriptions(self) -> list[bytes]:
        """All that describes it, patches first."""
        return [*(each.encode() for each in self.patches), self.layout.encode()]

    @property
    def hashes(self) -> list[bytes]:
        """Of the same, in the same order."""
        return [*self.layout.patches, self.layout.content_hash]

    def frame(
        self,
        sequence: int,
        values: dict[int, Floats] | None = None,
        *,
        boot: int = 1,
        page: int = 0,
        rows: int = 5,
        coverage: float = 1.0,
        strides: bytes = b"",
    ) -> Frame:
        """A frame of a page; ``values`` are the lower bounds of patches, each 100 wide."""
        start = EPOCH + sequence * rows * PERIOD
        samples = []
        for number in self.layout.page_range(page):
            each = self.patches[number]
            shape = rows, len(each.taxels)
            lo = (
                np.full(shape, 1000.0) if values is None else np.broadcast_to(values[number], shape)
            )
            hi = np.where(lo == -np.inf, 100.0, lo + 100.0)
            samples.append(
                PatchSamples.pack(
                    Interval(lo, hi), each.least_width, patch=number, grid=0,
                    first_row=sequence * rows, strides=strides,
                )
            )  # fmt: skip
        grid = Grid(0, PERIOD, sequence * rows, rows, coverage)
        layout = self.layout.content_hash
        instant = start, start + 500
        return Frame(Position(boot, sequence), layout, page, 0, instant, (grid,), tuple(samples))

    def peaks(self, sequence: int, *, boot: int = 1, number: int = 0) -> Statements:
        """A peak of a patch."""
        return replace(self.statements(sequence, boot=boot, number=number), contacts=(), gaps=())

    def statements(self, sequence: int, *, boot: int = 1, number: int = 0) -> Statements:
        """A peak of a patch, a contact and a gap."""
        instants = EPOCH, EPOCH + 9
        return Statements(
            Position(boot, sequence),
            self.layout.content_hash,
            peaks=(
                frames.Peak(
                    number, 0, instants, Verdict.POSSIBLE, (0, 2), (1.0, np.inf), (0.5, 1.5), 0.99
                ),
            ),
            contacts=(
                frames.Contact(
                    7, instants, Verdict.CERTAIN, (1, 2), (1, 3), (0.5, 1.5), ((0.0, 0.1),) * 2, 0.9
                ),
            ),
            gaps=(frames.Gap("flash full", instants, 2, 200, ((1, 0, 1),), (number,)),),
        )  # fmt: skip


class SkinNode:
    """What a node does with its skin: it sends again, and describes what it is asked for.

    Args:
        node: The node, connected.
        skin: Its skin.
    """

    def __init__(self, node: WireNode, skin: SkinOf) -> None:
        self.node = node
        self.skin = skin
        self.described: dict[bytes, Patch | Layout] = dict(
            zip(skin.hashes, (*skin.patches, skin.layout), strict=True)
        )
        self._answered = 0

    def describe(self) -> None:
        """Send all descriptions, as at a connection."""
        for each in self.described.values():
            self.node.say(Stream.LAYOUTS, each)

    def answer(self) -> None:
        """Send what was asked for since the last call."""
        wanted = self.node.wanted[self._answered :]
        self._answered += len(wanted)
        for name in dict.fromkeys(wanted):
            self.node.say(Stream.LAYOUTS, self.described[name])

    def send(self, *sequences: int, page: int = 0) -> None:
        """Send frames until they are acknowledged."""
        sent = time.monotonic() - 1.0

        def acknowledged() -> bool:
            nonlocal sent
            left = [k for k in sequences if (1, k) not in self.node.acknowledged]
            self.answer()
            if left and self.node.ready and time.monotonic() > sent + 0.5:
                sent = time.monotonic()
                for number in left:
                    self.node.say(Stream.FRAMES, self.skin.frame(number, page=page))
            return not left

        wait_until(acknowledged, f"frames {sequences} are acknowledged")


SMALL = SkinOf(patch(0, 3), patch(1, 2))
LARGE = SkinOf(*(patch(number, 20) for number in range(4)), pages=(2, 2))
MIXED = SkinOf(patch(0, 3), WEARER, pages=(1, 1))
HIGH = replace(patch(0, 3), patch_id="high", taxels=("bio-1",), privacy=Privacy.BIOMETRIC,
               subject="wearer")  # fmt: skip
TOUCHED = SkinOf(patch(0, 3), HIGH, pages=(1, 1))
"""Contacts may be of a biometric patch, too."""
