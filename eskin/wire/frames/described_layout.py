"""A layout with its patches: by it frames and statements are read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from eskin.errors import MessageError
from eskin.wire.frames.patch import Patch, Privacy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.wire.frames.encoded_frame import EncodedFrame
    from eskin.wire.frames.layout import Layout
    from eskin.wire.frames.statements import Statements


@dataclass(frozen=True, eq=False)
class DescribedLayout:
    """A layout with its patches.

    Attributes:
        hash: The layout's.
        layout: The layout.
        patches: Its patches, in its order.
    """

    hash: bytes
    layout: Layout
    patches: tuple[Patch, ...]

    @classmethod
    def of(cls, layout: Layout, patches: Sequence[Patch]) -> Self:
        """A layout whose patches fit it.

        Raises:
            MessageError: They do not.
        """
        layout.require_patches(patches)
        return cls(layout.content_hash, layout, tuple(patches))

    @cached_property
    def places(self) -> Mapping[str, tuple[int, int]]:
        """Number of the patch and the column, by channel."""
        return {
            channel: (number, column)
            for number, patch in enumerate(self.patches)
            for column, channel in enumerate(patch.channels)
        }

    @cached_property
    def controllers(self) -> tuple[str, ...]:
        """Who samples each page; empty where the node that states the layout is the only one."""
        return tuple(c.node for c in self.layout.controllers for _ in range(c.pages))

    @cached_property
    def units(self) -> dict[str, str]:
        """The unit, by channel."""
        return {channel: each.unit for each in self.patches for channel in each.channels}

    @cached_property
    def facts(self) -> NDArray[np.int64]:
        """Of each patch: number of columns, whether errors are shared, least and greatest skew."""
        return np.array(
            [
                (
                    len(each.taxels),
                    bool(each.alpha),
                    min(each.skew, default=0),
                    max(each.skew, default=0),
                )
                for each in self.patches
            ]
        )

    @cached_property
    def channels(self) -> int:
        """How many channels all patches have."""
        return int(self.facts[:, 0].sum())

    @cached_property
    def page_ranges(self) -> tuple[range, ...]:
        """For each page, the numbers of its patches."""
        return tuple(map(self.layout.page_range, range(len(self.layout.pages))))

    @cached_property
    def biometric_pages(self) -> tuple[int, ...]:
        """Pages whose samples are data about a person."""
        return tuple(
            page
            for page, numbers in enumerate(self.page_ranges)
            if self.patches[numbers.start].privacy is Privacy.BIOMETRIC
        )

    def public_patches(self, node: str) -> list[Patch]:
        """The patches that a node samples and whose samples are not data about a person."""
        owners = [c.node for c in self.layout.controllers for _ in range(c.pages)]
        return [
            self.patches[number]
            for page, numbers in enumerate(self.page_ranges)
            if page not in self.biometric_pages and (not owners or owners[page] == node)
            for number in numbers
        ]

    def require_frame(self, frame: EncodedFrame) -> Privacy:
        """Check that a frame fits, as `Frame.require_layout` does.

        Returns:
            The privacy class of its page.

        Raises:
            MessageError: It does not.
        """
        if frame.page >= len(self.page_ranges):
            raise MessageError(f"page is {frame.page}; the layout has {len(self.page_ranges)}")
        numbers, page = frame.records["patch"], self.page_ranges[frame.page]
        if numbers[0] < page.start or numbers[-1] >= page.stop:
            raise MessageError(
                f"patches {numbers[0]} to {numbers[-1]} are not all on page {frame.page}"
            )
        columns, shares_errors, *_ = self.facts[numbers].T
        for wrong, what in (
            (frame.records["columns"] != columns, "another number of columns"),
            ((frame.records["epoch"] > 0) & (shares_errors == 0), "no shared error"),
        ):
            if wrong.any():
                number = numbers[np.flatnonzero(wrong)[0]]
                raise MessageError(f"patch {number} has {what} by its description")
        return self.patches[page.start].privacy

    def require_statements(self, message: Statements) -> Privacy:
        """Check that statements name patches and columns of this layout, and are of one class.

        A peak has the class of its patch; a contact that of all patches with a threshold; a
        verdict, whose monitor may read any patch, that of all patches. Gaps are public: so
        statements about a person hold none.

        Returns:
            Their privacy class.

        Raises:
            MessageError: They do not, or are of two classes.
        """
        self._require_named(message)
        found = {self.patches[peak.patch].privacy for peak in message.peaks}
        if message.contacts:
            found |= {each.privacy for each in self.patches if each.threshold is not None}
        if message.verdicts:
            found |= {each.privacy for each in self.patches}
        if message.gaps:
            found.add(Privacy.PUBLIC)
        if len(found) > 1:
            raise MessageError(
                "statements are of public and of biometric patches; divide them into two messages, "
                "gaps with the public ones"
            )
        return max(found, default=Privacy.PUBLIC)

    def _require_named(self, message: Statements) -> None:
        named = [peak.patch for peak in message.peaks]
        named += [number for gap in message.gaps for number in gap.patches]
        if named and max(named) >= len(self.patches):
            raise MessageError(
                f"patch {max(named)} is named; the layout has {len(self.patches)} patches"
            )
        for peak in message.peaks:
            columns = len(self.patches[peak.patch].taxels)
            if peak.column >= columns:
                raise MessageError(
                    f"column {peak.column} of patch {peak.patch} is named; it has {columns}"
                )
